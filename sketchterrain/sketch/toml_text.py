"""``sketch.toml``: strict parsing, and writing with the meaning of each line as a comment."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, TypeVar

from sketchterrain.errors import InputError
from sketchterrain.sketch.document import Sketch
from sketchterrain.sketch.edits import ACTIONS, Edit, parse_edit
from sketchterrain.sketch.material_rule import FACTOR, RULE, RuleChange
from sketchterrain.sketch.material_rules import parse_rule_change
from sketchterrain.sketch.parameters import FORMAT, LAYERS, LOOK, SKETCH, TABLES
from sketchterrain.sketch.toml_reading import load_toml
from sketchterrain.sketch.wording import format_value, unknown_key

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sketchterrain.sketch.parameter import Parameter, Properties, Value

_Row = TypeVar("_Row")

_COMMENT_COLUMN = 28

_HEAD = """\
# A sketch of a terrain. Beside this file lies one 8-bit single-channel PNG a layer: 0 is empty, every
# other value is a label, and [layer.label] below says what the label means. What is missing has its default.
"""


def parse_settings(data: bytes) -> Sketch:
    """Return the unpainted sketch in ``sketch.toml``; raise InputError for invalid TOML, keys or values."""
    document = load_toml(data)
    _check_format(document.pop("format", None))
    fields: dict[str, object] = {}
    labels: dict[tuple[str, int], object] = {}
    for key, value in document.items():
        if key in LAYERS:
            labels |= {(key, label): properties for label, properties in _label_tables(key, value)}
        elif key in TABLES:
            fields[key] = _as_table(f"[{key}]", value)
        elif key == "look":
            tables = _as_table("[look.grass]" if not isinstance(value, dict) else "[look]", value)
            fields[key] = {name: _as_table(f"[look.{name}]", table) for name, table in tables.items()}
        elif key in SKETCH:
            fields[key] = value
        elif key == "edit":
            fields["edits"] = _rows(key, value, parse_edit)
        elif key == "material_rule":
            fields["material_rules"] = _rows(key, value, parse_rule_change)
        else:
            known = ["format", *SKETCH, *TABLES, *LAYERS, "look", "material_rule", "edit"]
            raise unknown_key(key, value, known)
    return Sketch(**fields, labels=labels)  # type: ignore[arg-type] # Sketch checks every value


def settings_text(sketch: Sketch) -> str:
    """Return a sketch's settings as TOML; a comment on each line gives its meaning, range and unit."""
    lines = [_HEAD, f"format = {FORMAT}"]
    lines += _lines({key: getattr(sketch, key) for key in SKETCH}, SKETCH)
    for key, table in TABLES.items():
        lines += ["", f"[{key}]", *_lines(getattr(sketch, key), table)]
    for name, look in sketch.look.items():
        lines += ["", f"[look.{name}]", *_lines(look, LOOK)]
    explained: set[str] = set()
    for (name, label), properties in sketch.labels.items():
        lines.append("")
        if name not in explained:
            lines.append(f"# {name}.png: {LAYERS[name].help}")
            explained.add(name)
        lines += [f"[{name}.{label}]", *_lines(properties, LAYERS[name].parameters)]
    if sketch.material_rules:
        lines += ["", "# Rules by which materials cover the ground, where they differ from the table's."]
    for change in sketch.material_rules:
        lines += _rule_lines(change)
    if sketch.edits:
        lines += ["", f"# Changed by hand: {', '.join(ACTIONS)}."]
    for edit in sketch.edits:
        lines += [
            "",
            "[[edit]]",
            *(f"{key} = {_written(value)}" for key, value in _edit_entries(edit).items()),
        ]
    return "\n".join(lines) + "\n"


def _rows(key: str, value: object, read: Callable[[Mapping[str, object]], _Row]) -> tuple[_Row, ...]:
    """Return the parsed tables ``[[key]]``."""
    if not isinstance(value, list) or not all(isinstance(each, dict) for each in value):
        raise InputError(
            f"{key} = {format_value(value)}: expected tables, each with [[{key}]] on a line of its own"
        )
    rows = []
    for number, table in enumerate(value, 1):
        try:
            rows.append(read(table))
        except InputError as error:
            raise InputError(f"[[{key}]] number {number}: {error}") from None
    return tuple(rows)


def _rule_lines(change: RuleChange) -> list[str]:
    lines = ["", "[[material_rule]]", *_lines(change.values, RULE)]
    if change.factors == ():
        lines.append("factor = []".ljust(_COMMENT_COLUMN) + " # it covers as much everywhere")
    for factor in change.factors or ():
        lines += ["[[material_rule.factor]]", *_lines(factor.values, FACTOR)]
    return lines


def _edit_entries(edit: Edit) -> dict[str, Value]:
    feature = {} if edit.action == "add" or edit.feature is None else {"feature": edit.feature}
    return {"action": edit.action, **feature, **edit.values}


def _check_format(given: object) -> None:
    if isinstance(given, bool) or given != FORMAT or not isinstance(given, int):
        got = "no such key" if given is None else format_value(given)
        raise InputError(f"format = {FORMAT} expected, got {got}")


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
        f"{name} = {_written(values[name])}".ljust(_COMMENT_COLUMN)
        + f" # {parameter.help} ({parameter.range} {parameter.unit}".rstrip()
        + ")"
        for name, parameter in table.items()
        if name in values
    ]


def _written(value: Value) -> str:
    if isinstance(value, str):
        # JSON's escapes are valid TOML; DEL is the one control character that JSON does not escape.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
