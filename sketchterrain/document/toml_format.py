"""``sketch.toml``: reading, writing, the starter sketch and the generated reference tables."""

import dataclasses
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from sketchterrain.document.drapes import CLASS, DRAPE, DrapedLayer, parse_drape
from sketchterrain.document.edits import ACTIONS, Edit, added_id, parse_edit
from sketchterrain.document.label_layers import LabelImage, labels_in
from sketchterrain.document.material_rules import FACTOR, RULE, RuleChange, parse_rule_change
from sketchterrain.document.own_materials import OWN
from sketchterrain.document.rasters import RASTER, parse_raster
from sketchterrain.document.sketch import DEFAULT_SIDE, TABLES, Sketch
from sketchterrain.errors import InputError, check_keys, check_tables, format_value, one_line, prefix_errors
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.schema.parameters import FORMAT, LOOK, SKETCH, Parameter, Properties, Value, defaults
from sketchterrain.schema.styles import STYLE

_MAX_DOTS = 250
_EXAMPLES = {"look": MATERIALS[0], "materials": "lava"}  # of a table's name


def load_toml(data: bytes) -> dict[str, object]:
    """Parse TOML (UTF-8, with or without a byte-order mark); raise InputError with the line number."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"line {line} is not UTF-8: expected a UTF-8 text file") from None
    # The parser's time and memory grow with the square of a dotted key's depth.
    deep = next((n for n, line in enumerate(text.split("\n"), 1) if line.count(".") > _MAX_DOTS), None)
    if deep is not None:
        raise InputError(f"line {deep} has more than {_MAX_DOTS} dots: it is nested too deeply")
    try:
        return tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, or an integer of too many digits
        last = text.rstrip().count("\n") + 1
        reason = one_line(error).replace("at end of document", f"at line {last}, the last one")
        raise InputError(f"not TOML: {reason}") from None
    except RecursionError:
        raise InputError("it is nested too deeply") from None


_Parsed = TypeVar("_Parsed")

_COMMENT_COLUMN = 28
_UNPAINTED: Mapping[str, LabelImage] = MappingProxyType({})
_FORMER_HEIGHTS = {"mountain": 600.0, "hill": 80.0}  # m, defaults in format 1
_FORMER_WIDTH = "gullies"  # width of the widest gullies in format 1, of mountains and hills

_HEAD = """\
# A sketch of a terrain. Painted layers are 8-bit single-channel PNGs in this folder: 0 is empty, other
# values are labels. Labels have the properties in [layer.label] below; missing values have defaults.
"""


def parse_settings(data: bytes, layers: Mapping[str, LabelImage] = _UNPAINTED) -> Sketch:
    """Return the sketch in ``sketch.toml``; raise InputError for invalid TOML, keys or values.

    Older formats are converted: the terrain stays as its settings and `layers` describe it.
    """
    document = load_toml(data)
    version = _checked_format(document.pop("format", None))
    fields: dict[str, object] = {}
    labels: dict[tuple[str, int], object] = {}
    for key, value in document.items():
        if key in LAYERS:
            labels |= {(key, label): properties for label, properties in _label_tables(key, value)}
        elif key in TABLES:
            fields[key] = _as_table(f"[{key}]", value)
        elif key in _EXAMPLES:
            tables = _as_table(
                f"[{key}.{_EXAMPLES[key]}]" if not isinstance(value, dict) else f"[{key}]", value
            )
            fields[key] = {name: _as_table(f"[{key}.{name}]", table) for name, table in tables.items()}
        elif key in SKETCH:
            fields[key] = value
        elif key == "edit":
            fields["edits"] = (_parse_former_edits if version == 1 else _parse_edits)(value)
        elif key == "material_rule":
            fields["material_rules"] = _parse_tables(key, value, parse_rule_change)
        elif key == "raster":
            fields["rasters"] = _parse_tables(key, value, parse_raster)
        elif key == "drape":
            fields["drapes"] = _parse_tables(key, value, parse_drape)
        else:
            others = ("materials", "look", "raster", "drape", "material_rule", "edit")
            check_keys({key: value}, ["format", *SKETCH, *TABLES, *LAYERS, *others])
    if version == 1:
        labels = _with_former_heights(_without_former_widths(labels), layers)
    return Sketch(**fields, labels=labels, layers=layers)  # type: ignore[arg-type] # Sketch checks every value


def settings_text(sketch: Sketch) -> str:
    """Return a sketch's settings as TOML; a comment on each line gives its meaning, range and unit."""
    lines = [_HEAD, f"format = {FORMAT}"]
    lines += _lines({key: getattr(sketch, key) for key in SKETCH}, SKETCH)
    for key, table in TABLES.items():
        values = getattr(sketch, key)
        if key != "base" or sketch.elevation_rasters or values != defaults(table):
            lines += ["", f"[{key}]", *_lines(values, table)]
    for name, values in sketch.materials.items():
        lines += ["", f"[materials.{name}]", *_lines(values, OWN)]
    for name, look in sketch.look.items():
        lines += ["", f"[look.{name}]", *_lines(look, LOOK)]
    explained: set[str] = set()
    for (name, label), properties in sketch.labels.items():
        lines.append("")
        if name not in explained:
            lines.append(f"# {LAYERS[name].file}: {LAYERS[name].help}")
            explained.add(name)
        lines += [f"[{name}.{label}]", *_lines(properties, LAYERS[name].parameters)]
    for source in sketch.rasters:
        lines += ["", "[[raster]]", *_lines(source.stored_values, RASTER)]
    for layer in sketch.drapes:
        lines += _drape_lines(layer)
    if sketch.material_rules:
        lines += ["", "# Changes of the default material rules."]
    for change in sketch.material_rules:
        lines += _rule_lines(change)
    if sketch.edits:
        lines += ["", f"# Edits of generated features: {', '.join(ACTIONS)}."]
    for edit in sketch.edits:
        entries: dict[str, Any] = {"action": edit.action}
        if edit.action != "add":
            entries["feature"] = edit.feature
        entries |= edit.values
        lines += ["", "[[edit]]", *(f"{key} = {_toml_value(value)}" for key, value in entries.items())]
    return "\n".join(lines) + "\n"


def _parse_tables(
    key: str, value: object, read: Callable[[Mapping[str, object]], _Parsed]
) -> tuple[_Parsed, ...]:
    """Return the parsed tables ``[[key]]``."""
    rows = []
    for number, table in enumerate(check_tables(key, value, f"[[{key}]] on a line of its own"), 1):
        with prefix_errors(f"[[{key}]] number {number}"):
            rows.append(read(table))
    return tuple(rows)


def _parse_edits(value: object) -> tuple[Edit, ...]:
    return _parse_tables("edit", value, parse_edit)


def _parse_former_edits(value: object) -> tuple[Edit, ...]:
    """Return the edits of format 1 without the width of gullies, which ids were hashes of too."""
    tables = value if isinstance(value, list) else []
    widths = [
        table.pop(_FORMER_WIDTH, None)
        if isinstance(table, dict) and table.get("action") in ("lock", "add")
        else None
        for table in tables
    ]
    edits = _parse_edits(value)
    ids = {
        added_id({**edit.values, _FORMER_WIDTH: float(width)}): edit.feature
        for edit, width in zip(edits, widths, strict=True)
        if edit.action == "add" and isinstance(width, int | float) and abs(width) <= 1.0
    }
    return tuple(
        dataclasses.replace(edit, feature=ids[edit.feature]) if edit.feature in ids else edit
        for edit in edits
    )


def _rule_lines(change: RuleChange) -> list[str]:
    lines = ["", "[[material_rule]]", *_lines(change.values, RULE)]
    if change.factors == ():
        lines.append("factor = []".ljust(_COMMENT_COLUMN) + " # uniform cover")
    for factor in change.factors or ():
        lines += ["[[material_rule.factor]]", *_lines(factor.values, FACTOR)]
    return lines


def _drape_lines(layer: DrapedLayer) -> list[str]:
    lines = ["", "[[drape]]", *_lines(layer.stored_values, {**DRAPE, **STYLE})]
    for each in layer.classes:
        lines += ["[[drape.class]]", *_lines({"value": each.value, **each.style}, CLASS)]
    return lines


def _checked_format(given: object) -> int:
    if isinstance(given, bool) or not isinstance(given, int) or not 1 <= given <= FORMAT:
        got = "no such key" if given is None else format_value(given)
        expected = " or ".join(str(each) for each in range(1, FORMAT + 1))
        raise InputError(f"format = {expected} expected, got {got}")
    return given


def _without_former_widths(labels: Mapping[tuple[str, int], object]) -> dict[tuple[str, int], object]:
    """Return labels without the width of gullies, which mountains and hills had in format 1."""
    return {
        key: {name: each for name, each in table.items() if name != _FORMER_WIDTH}
        if key[0] in _FORMER_HEIGHTS and isinstance(table, dict)
        else table
        for key, table in labels.items()
    }


def _with_former_heights(
    labels: Mapping[tuple[str, int], object], layers: Mapping[str, LabelImage]
) -> dict[tuple[str, int], object]:
    """Return labels with the height that those without one had in format 1."""
    explicit = dict(labels)
    for layer, height in _FORMER_HEIGHTS.items():
        painted = labels_in(layers[layer]) if layer in layers else ()
        for key in {(layer, label) for label in painted} | {key for key in labels if key[0] == layer}:
            explicit[key] = {"height": height, **_as_table(f"[{layer}.{key[1]}]", labels.get(key, {}))}
    return explicit


def _as_table(where: str, value: object) -> Mapping[str, object]:
    if not isinstance(value, dict):
        raise InputError(f"{where} = {format_value(value)}: expected a table, {where} on a line of its own")
    return value


def _label_tables(layer: str, value: object) -> list[tuple[int, Mapping[str, object]]]:
    tables = []
    for key, properties in _as_table(f"[{layer}.1]" if not isinstance(value, dict) else layer, value).items():
        is_label = key.isascii() and key.isdigit() and len(key) <= 3 and not key.startswith("0")
        if not is_label or int(key) > 255:
            raise InputError(
                f"key {format_value(key)} = {format_value(properties)} in [{layer}]: expected a table for a "
                f"label from 1 to 255, for example [{layer}.1]"
            )
        tables.append((int(key), _as_table(f"[{layer}.{key}]", properties)))
    return tables


def _lines(values: Properties, table: Mapping[str, Parameter]) -> list[str]:
    return [
        f"{name} = {_toml_value(values[name])}".ljust(_COMMENT_COLUMN)
        + f" # {parameter.help} ({parameter.range} {parameter.unit}".rstrip()
        + ")"
        for name, parameter in table.items()
        if name in values
    ]


def _toml_value(value: Value) -> str:
    if isinstance(value, str):
        # JSON's escapes are valid TOML; DEL is the one control character that JSON does not escape.
        text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        return text if value.count(".") < _MAX_DOTS - 50 else text.replace(".", "\\u002e")
    return repr(value)


_Dab = tuple[float, float, float]
"""Column, row and radius of a round brush, px."""

_MOUNTAIN: Sequence[_Dab] = (
    (96, 160, 34),
    (140, 128, 46),
    (176, 140, 52),
    (222, 112, 40),
    (236, 158, 44),
    (176, 190, 30),
)
_RIVER: Sequence[_Dab] = (
    (270, 196, 3),
    (296, 240, 4),
    (282, 292, 4),
    (330, 336, 5),
    (392, 352, 5),
    (416, 410, 6),
    (468, 446, 6),
    (511, 480, 7),
)


def starter_sketch(size: tuple[float, float] | None = None) -> Sketch:
    """Return a sketch of one mountain and one river, with label 1 of every layer declared in full.

    `size` is that of the sketch in metres, eastward and northward.
    """
    sketch = Sketch(
        name="My sketch",
        seed=1,
        density={"hill": 0.5, "forest": 0.5},
        layers={"mountain": _stroke(_MOUNTAIN), "river": _stroke(_RIVER)},
        labels={
            (layer.name, 1): {name: parameter.default for name, parameter in layer.parameters.items()}
            for layer in LAYERS.values()
        },
    )
    if size is None:
        return sketch
    extent = float(SKETCH["extent"].check(max(size), "extent"))
    sides = [max(round(DEFAULT_SIDE * side / extent), 1) for side in size]
    columns, rows = (np.arange(side) * DEFAULT_SIDE // side for side in sides)
    layers = {name: image[np.ix_(rows, columns)] for name, image in sketch.layers.items()}
    return sketch.replace(extent=extent, layers=layers)


def _stroke(dabs: Sequence[_Dab]) -> LabelImage:
    """Return a layer with label 1 along the polyline through the dabs, as wide as they are."""
    rows, columns = np.ogrid[:DEFAULT_SIDE, :DEFAULT_SIDE]
    image = np.zeros((DEFAULT_SIDE, DEFAULT_SIDE), dtype=np.uint8)
    for start, end in pairwise(dabs):
        for part in np.linspace(0.0, 1.0, 24):
            column, row, radius = (a + (b - a) * part for a, b in zip(start, end, strict=True))
            image[(columns - column) ** 2 + (rows - row) ** 2 <= radius**2] = 1
    return image
