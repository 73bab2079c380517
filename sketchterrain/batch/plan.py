"""Plan of a batch: sweep files, swept settings, and the terrains of their combinations."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from decimal import Decimal
from hashlib import sha256
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from sketchterrain.document.sketch import TABLES, Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.document.toml_format import load_toml
from sketchterrain.errors import InputError, SketchterrainError, did_you_mean, format_value, one_line
from sketchterrain.export.target import ExportOptions
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import SKETCH, Parameter, format_number

MAX_SEEDS: Final = 10_000
MAX_VALUES: Final = 1000
EXPORT_KEYS: Final = [each.name for each in fields(ExportOptions) if each.name not in ("size", "grass")]
_SEEDS = re.compile(r"\s*(\d{1,19})(?:\s*-\s*(\d{1,19}))?\s*", re.ASCII)
_NUMBER = r"\s*(-?(?:\d+(?:\.\d+)?|\.\d+)(?:e[+-]?\d{1,3})?)\s*"
_STEPS = re.compile(rf"{_NUMBER}\.\.{_NUMBER}(?:\.\.{_NUMBER})?", re.IGNORECASE | re.ASCII)
_NOT_SWEPT = ("name", "seed")

Value = int | float | str
Settings = Mapping[str, Value]


class SweptSetting(NamedTuple):
    """A setting (``fidelity``, ``density.hill`` or ``river.1.width``) and its values."""

    name: str
    values: tuple[Value, ...]


class SweepFile(msgspec.Struct, frozen=True):
    """A batch as a TOML file, with the keys of `ExportOptions` in `export`; None or empty: not set."""

    sketches: str | list[str] = []
    seeds: str | int | list[int] = ""
    size: int | None = None
    preview: bool | None = None
    view: str | None = None
    foliage: str | None = None
    grass: bool | None = None
    map: str | None = None
    to: str | None = None
    export: dict[str, Any] = {}
    set: dict[str, Any] = {}

    @property
    def seed_list(self) -> tuple[int, ...]:
        """The seeds as numbers."""
        seeds = self.seeds if isinstance(self.seeds, list) else [self.seeds]
        return () if seeds in ([], [""]) else parse_seeds(",".join(map(str, seeds)))

    @property
    def settings(self) -> tuple[SweptSetting, ...]:
        """The settings of ``[set]``, with dotted names or as nested tables."""
        return tuple(_flattened(self.set))


class _Export(msgspec.Struct):
    export: ExportOptions = ExportOptions()


def read_sweep(path: Path) -> SweepFile:
    """Read a sweep file; sketches may be relative to it. Raise InputError."""
    try:
        document = load_toml(path.read_bytes())
        _check_keys(document, SweepFile.__struct_fields__)
        file = msgspec.convert(document, type=SweepFile)
        _check_keys(file.export, EXPORT_KEYS, "export.")
        options = msgspec.convert(document, type=_Export).export
        _ = file.seed_list, file.settings
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    except InputError as error:
        raise InputError(f"{one_line(path)}: {error}") from None
    except msgspec.ValidationError as error:
        reason = one_line(error).replace("`", "").replace("$.", "").replace("Expected", "expected")
        raise InputError(f"{one_line(path)}: {reason}") from None
    names = [file.sketches] if isinstance(file.sketches, str) else file.sketches
    found = [str(path.parent / name) if (path.parent / name).exists() else name for name in names]
    given = {name: getattr(options, name) for name in file.export}
    return msgspec.structs.replace(file, sketches=found, export=given)


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the unique seeds of a text such as ``1,5,9-12``, in its order; raise InputError."""
    highest = int(SKETCH["seed"].high)
    seeds: dict[int, None] = {}
    for part in text.split(","):
        match = _SEEDS.fullmatch(part)
        if match is None or int(match[2] or match[1]) < int(match[1]):
            raise InputError(
                f"seeds {format_value(text)}: expected numbers and rising ranges such as 1-100 or 1,5,9-12"
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if last > highest:
            raise InputError(f"seeds {format_value(text)}: expected seeds from 0 to {highest}")
        if len(seeds) + last - first >= MAX_SEEDS:
            raise InputError(f"seeds {format_value(text)}: expected at most {MAX_SEEDS} of them")
        seeds |= dict.fromkeys(range(first, last + 1))
    return tuple(seeds)


def parse_settings(texts: Sequence[str], defaults: Sequence[SweptSetting] = ()) -> tuple[SweptSetting, ...]:
    """Parse settings ``NAME=VALUES`` and add those of `defaults` that are not set; raise InputError."""
    found: dict[str, SweptSetting] = {}
    for text in texts:
        name, equals, values = text.partition("=")
        name = name.strip()
        if not equals:
            raise InputError(f"{format_value(text)}: expected NAME=VALUES, as river.1.width=20,30")
        if name in found:
            raise InputError(f"{name} is set twice: expected all its values at once, as {name}=1,2")
        found[name] = parse_setting(name, values)
    return (*(each for each in defaults if each.name not in found), *found.values())


def parse_setting(name: str, values: str | Sequence[object]) -> SweptSetting:
    """Return a setting with values ``30``, ``10,20,30``, ``10..50..10`` or a list; raise InputError."""
    parameter = _declared(name)
    listed = _parse_values(name, values, parameter) if isinstance(values, str) else list(values)
    if not 1 <= len(listed) <= MAX_VALUES:
        raise InputError(f"{name}: expected 1 to {MAX_VALUES} values, got {len(listed)}")
    return SweptSetting(name, tuple(dict.fromkeys(parameter.check(value, name) for value in listed)))


def with_settings(sketch: Sketch, settings: Settings) -> Sketch:
    """Return a sketch with settings applied, as named by `parse_setting`."""
    for name, value in settings.items():
        match name.split("."):
            case [key]:
                sketch = sketch.replace(**{key: value})
            case [table, key]:
                sketch = sketch.replace(**{table: {**getattr(sketch, table), key: value}})
            case [layer, number, key]:
                label = (layer, int(number))
                declared = {**sketch.labels.get(label, {}), key: value}
                sketch = sketch.replace(labels={**sketch.labels, label: declared})
    return sketch


def applies_to(sketch: Sketch, name: str) -> bool:
    """Return whether a setting applies to a sketch: its label must be painted."""
    parts = name.split(".")
    return len(parts) < 3 or bool((sketch.layers[parts[0]] == int(parts[1])).any())


def _declared(name: str) -> Parameter:
    match name.split("."):
        case [key] if key in SKETCH and key not in _NOT_SWEPT:
            return SKETCH[key]
        case [table, key] if key in TABLES.get(table, {}):
            return TABLES[table][key]
        case [layer, label, key] if layer in LAYERS and key in LAYERS[layer].parameters:
            if re.fullmatch(r"[1-9][0-9]{0,2}", label) and int(label) <= 255:
                return LAYERS[layer].parameters[key]
            raise InputError(f"{format_value(name)}: expected a label from 1 to 255, as in {layer}.1.{key}")
        case [layer, *rest] if rest and layer in LAYERS:
            label = rest[0] if rest[0].isdecimal() else "1"
            known = [f"{layer}.{label}.{key}" for key in LAYERS[layer].parameters]
        case [table, *_] if table in TABLES:
            known = [f"{table}.{key}" for key in TABLES[table]]
        case _:
            known = [key for key in SKETCH if key not in _NOT_SWEPT]
            known += [f"{key}.…" for key in TABLES] + [f"{key}.1.…" for key in LAYERS]
    raise InputError(
        f"unknown setting {format_value(name)}: expected {', '.join(known)}{did_you_mean(name, known)}"
    )


def _parse_values(name: str, text: str, parameter: Parameter) -> list[object]:
    parts = [part.strip() for part in text.split(",")]
    steps = _STEPS.fullmatch(text)
    if parameter.kind is str or steps is None:
        return [part if parameter.kind is str else _parse_number(part) for part in parts]
    first, last, step = Decimal(steps[1]), Decimal(steps[2]), Decimal(steps[3] or "1")
    if step <= 0 or last < first:
        raise InputError(f"{name} = {format_value(text)}: expected FROM..TO..STEP that rises")
    if (last - first) / step >= MAX_VALUES:
        raise InputError(f"{name} = {format_value(text)}: expected at most {MAX_VALUES} values")
    # In decimals, so that 0.1..0.5..0.1 ends at 0.5.
    return [_parse_number(str(first + step * number)) for number in range(int((last - first) / step) + 1)]


def _parse_number(text: str) -> float | str:
    """Return a number, or the text if it is not one, which the parameter then rejects."""
    try:
        number = float(text)
    except ValueError:
        return text
    return int(number) if number.is_integer() and abs(number) < 1 << 53 else number


def _flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[SweptSetting]:
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _flattened(value, f"{prefix}{name}.")
        else:
            yield parse_setting(prefix + name, value if isinstance(value, list | str) else [value])


def _check_keys(table: Mapping[str, Any], known: Sequence[str], prefix: str = "") -> None:
    for name in table:
        if name not in known:
            expected = ", ".join(known) + did_you_mean(name, known)
            raise InputError(f"unknown key {format_value(prefix + name)}: expected {expected}")


MAX_ITEMS: Final = 10_000  # the manifest is written after each
_LONGEST: Final = 120  # characters of a folder's name
_UNSAFE = re.compile(r"[^\w.=+-]", re.ASCII)


@dataclass(frozen=True)
class Source:
    """A sketch by its argument, with the name of its folder, or the reason why it cannot be read."""

    given: str
    name: str
    sketch: Sketch | None
    problem: str = ""


@dataclass(frozen=True)
class Item:
    """One terrain of a batch, named by its folder, as ``valley_river/seed-007``."""

    name: str
    source: Source
    seed: int
    settings: Settings = field(default_factory=dict)

    @property
    def sketch(self) -> Sketch:
        """The sketch with its seed and settings; raise InputError if it could not be read."""
        if self.source.sketch is None:
            raise InputError(self.source.problem)
        return with_settings(self.source.sketch.replace(seed=self.seed), self.settings)


def read_sources(given: Sequence[str]) -> tuple[Source, ...]:
    """Read sketches; raise InputError without one, for duplicates, or if none can be read."""
    if not given:
        raise InputError("expected at least one sketch")
    twice = next((each for index, each in enumerate(given) if each in given[:index]), None)
    if twice is not None:
        raise InputError(f"sketch {twice} is given twice")
    names: set[str] = set()
    sources: list[Source] = []
    for each in given:
        name = stem = _safe(Path(each).absolute().name.removesuffix(".sketch")) or "sketch"
        number = 2
        while name.casefold() in names:
            name, number = f"{stem}-{number}", number + 1
        names.add(name.casefold())
        try:
            sources.append(Source(each, name, load_sketch(each)))
        except SketchterrainError as error:
            sources.append(Source(each, name, None, str(error)))
    if all(source.sketch is None for source in sources):
        raise InputError(sources[0].problem)
    return tuple(sources)


def plan(
    sources: Sequence[Source], seeds: Sequence[int] = (), swept: Sequence[SweptSetting] = ()
) -> tuple[Item, ...]:
    """Return every sketch with every combination of values and seeds (default: its own); raise InputError."""
    names = [each.name for each in swept]
    if len({*names}) < len(names):
        raise InputError(f"a setting is set twice: {', '.join(names)}")
    for name in names:
        if not any(source.sketch is not None and applies_to(source.sketch, name) for source in sources):
            layer, label, _ = name.split(".")
            raise InputError(f"{name}: no sketch of the batch has a label {label} in its layer {layer}")
    count = len(sources) * max(len(seeds), 1) * prod(len(each.values) for each in swept)
    if count > MAX_ITEMS:
        raise InputError(f"{count} terrains: expected at most {MAX_ITEMS} in a batch")
    return tuple(
        _item(source, seed, dict(zip(names, values, strict=True)))
        for source in sources
        for values in product(*(each.values for each in swept))
        for seed in (seeds or (-1 if source.sketch is None else source.sketch.seed,))
    )


def _item(source: Source, seed: int, settings: Settings) -> Item:
    texts = {
        name: value if isinstance(value, str) else format_number(value) for name, value in settings.items()
    }
    combination = "_".join(f"{name}={_safe(text)}" for name, text in texts.items())
    if len(combination) > _LONGEST:
        combination = f"{combination[: _LONGEST - 9]}-{sha256(combination.encode()).hexdigest()[:8]}"
    last = "seed-unknown" if seed < 0 else f"seed-{seed:03}"  # unreadable sketch
    return Item("/".join(part for part in (source.name, combination, last) if part), source, seed, settings)


def _safe(name: str) -> str:
    """Return a folder name that is valid on every system: no separators, no spaces, not hidden."""
    return _UNSAFE.sub("_", name).lstrip(".-")[:_LONGEST]
