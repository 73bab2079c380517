"""Settings of a sketch by name, ``river.1.width=20,30``: what they mean, and a sketch that has them."""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS, SKETCH, TABLES
from sketchterrain.sketch.wording import did_you_mean, shown

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sketchterrain.sketch import Parameter, Sketch

__all__ = ["MOST_VALUES", "Settings", "Swept", "painted", "setting", "settings_given", "with_settings"]

Value: TypeAlias = int | float | str
Settings: TypeAlias = "Mapping[str, Value]"
"""Values by the names of what they set."""

MOST_VALUES = 1000
"""Of one setting in a batch."""
_NUMBER = r"\s*(-?(?:\d+(?:\.\d+)?|\.\d+)(?:e[+-]?\d{1,3})?)\s*"
_STEPS = re.compile(rf"{_NUMBER}\.\.{_NUMBER}(?:\.\.{_NUMBER})?", re.IGNORECASE | re.ASCII)
_NOT_SWEPT = ("name", "seed")


class Swept(NamedTuple):
    """One setting and the values that it takes.

    Attributes
    ----------
    name : str
        ``fidelity``, ``density.hill`` or ``river.1.width``.
    values : tuple
        At least one; each is of the kind and in the range that the setting declares.
    """

    name: str
    values: tuple[Value, ...]


def setting(name: str, values: str | Sequence[object]) -> Swept:
    """Return a setting and its values, checked.

    Parameters
    ----------
    name
        Of the setting.
    values
        As a text, ``30``, ``10,20,30`` or ``10..50..10`` (from, to, step), or one by one.

    Raises
    ------
    InputError
        If there is no such setting, or a value is not one that it takes.
    """
    parameter = _parameter(name)
    given = _listed(name, values, parameter) if isinstance(values, str) else list(values)
    if not given:
        raise InputError(f"{name}: expected a value")
    if len(given) > MOST_VALUES:
        raise InputError(f"{name}: expected at most {MOST_VALUES} values, got {len(given)}")
    checked = (parameter.check(value, name) for value in given)
    return Swept(name, tuple(dict.fromkeys(checked)))


def settings_given(texts: Sequence[str], *, instead_of: Sequence[Swept] = ()) -> tuple[Swept, ...]:
    """Return settings as a command line has them, each ``NAME=VALUES``, and others that it does not name.

    Raises
    ------
    InputError
        If a text is none, or sets what another one sets.
    """
    found: dict[str, Swept] = {}
    for text in texts:
        name, equals, values = text.partition("=")
        if not equals:
            raise InputError(f"{shown(text)}: expected NAME=VALUES, as river.1.width=20,30")
        name = name.strip()
        if name in found:
            raise InputError(f"{name} is set twice: expected all its values at once, as {name}=1,2")
        found[name] = setting(name, values)
    return (*(each for each in instead_of if each.name not in found), *found.values())


def with_settings(sketch: Sketch, settings: Settings) -> Sketch:
    """Return a sketch with other settings; names and values are those of `setting`."""
    for name, value in settings.items():
        parts = name.split(".")
        if len(parts) == 1:
            sketch = sketch.replace(**{name: value})
        elif len(parts) == 2:
            sketch = sketch.replace(**{parts[0]: {**getattr(sketch, parts[0]), parts[1]: value}})
        else:
            label = (parts[0], int(parts[1]))
            declared = {**sketch.labels.get(label, {}), parts[2]: value}
            sketch = sketch.replace(labels={**sketch.labels, label: declared})
    return sketch


def painted(sketch: Sketch, name: str) -> bool:
    """Tell whether a sketch has what a setting is of: a label must be painted."""
    parts = name.split(".")
    return len(parts) < 3 or bool((sketch.layers[parts[0]] == int(parts[1])).any())


def _parameter(name: str) -> Parameter:
    parts = name.split(".")
    if len(parts) == 1 and name in SKETCH and name not in _NOT_SWEPT:
        return SKETCH[name]
    if len(parts) == 2 and parts[0] in TABLES and parts[1] in TABLES[parts[0]]:
        return TABLES[parts[0]][parts[1]]
    if len(parts) == 3 and parts[0] in LAYERS and parts[2] in LAYERS[parts[0]].parameters:
        if re.fullmatch(r"[1-9][0-9]{0,2}", parts[1]) and int(parts[1]) <= 255:
            return LAYERS[parts[0]].parameters[parts[2]]
        raise InputError(f"{shown(name)}: expected a label from 1 to 255, as in {parts[0]}.1.{parts[2]}")
    raise InputError(f"unknown setting {shown(name)}: expected {_known(parts)}")


def _known(parts: Sequence[str]) -> str:
    """Return which settings there are beside one that there is not."""
    if parts[0] in LAYERS and len(parts) > 1:
        names = [f"{parts[0]}.{_label(parts)}.{key}" for key in LAYERS[parts[0]].parameters]
    elif parts[0] in TABLES:
        names = [f"{parts[0]}.{key}" for key in TABLES[parts[0]]]
    else:
        names = [key for key in SKETCH if key not in _NOT_SWEPT]
        names += [f"{key}.…" for key in TABLES] + [f"{key}.1.…" for key in LAYERS]
    return ", ".join(names) + did_you_mean(".".join(parts), names)


def _label(parts: Sequence[str]) -> str:
    return parts[1] if parts[1].isdecimal() else "1"


def _listed(name: str, text: str, parameter: Parameter) -> list[object]:
    steps = None if parameter.kind is str else _STEPS.fullmatch(text)
    if steps is not None:
        return _stepped(name, text, parameter, [steps[1], steps[2], steps[3] or "1"])
    return [_read(part.strip(), parameter) for part in text.split(",")]


def _read(text: str, parameter: Parameter) -> object:
    if parameter.kind is str:
        return text
    try:
        number = Decimal(text)
    except InvalidOperation:
        return text  # which the parameter refuses, with what it expects
    return _number(number, parameter) if number.is_finite() else text


def _number(value: Decimal, parameter: Parameter) -> object:
    if parameter.kind is int and value == value.to_integral_value() and abs(value) < 1 << 63:
        return int(value)
    return float(value)


def _stepped(name: str, text: str, parameter: Parameter, parts: list[str]) -> list[object]:
    """Return the values of a range: in decimals, so that 0.1..0.5..0.1 ends at 0.5."""
    first, last, step = (Decimal(part) for part in parts)
    if step <= 0 or last < first:
        raise InputError(f"{name} = {shown(text)}: expected FROM..TO..STEP that rises")
    count = int((last - first) / step) + 1
    if count > MOST_VALUES:
        raise InputError(f"{name} = {shown(text)}: expected at most {MOST_VALUES} values")
    return [_number(first + step * number, parameter) for number in range(count)]
