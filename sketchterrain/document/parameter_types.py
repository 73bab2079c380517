"""Declared parameters: name, type, range, unit and help of a setting, and its validation."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, TypeVar

from sketchterrain.errors import InputError, format_value, unknown_key

Value: TypeAlias = int | float | str

_T = TypeVar("_T")

Properties: TypeAlias = Mapping[str, Any]
"""Values by the names of their parameters, each of its parameter's kind."""


class Sentinel(NamedTuple):
    """A number that stands for a choice, such as -1 for "By elevation"; `start` is the first real number."""

    value: float
    title: str
    start: float


@dataclass(frozen=True)
class Parameter:
    """A setting: its key in the sketch file, its allowed values, and one line of help."""

    name: str
    kind: type[int] | type[float] | type[str]
    default: Value
    low: float  # of a str: its least length
    high: float
    unit: str  # empty for a pure number
    help: str
    choices: tuple[Value, ...] = ()
    form: tuple[str, str] = ("", "")  # of a str that is not empty: a regular expression, and its name
    sentinel: Sentinel | None = None
    soft_range: tuple[float, float] | None = None  # of sliders, where it is narrower than low … high

    @property
    def range(self) -> str:
        """The allowed values as text, for example ``"0 to 1"``."""
        if self.choices:
            return " or ".join(repr(choice) for choice in self.choices)
        if self.form[1]:
            return self.form[1]
        return f"{format_number(self.low)} to {format_number(self.high)}"

    @property
    def expected(self) -> str:
        """The allowed values for an error, for example ``"a number from 1 to 9000 m"``."""
        if self.choices or self.form[1]:
            return self.range
        if self.kind is str:
            return f"a text of {self.range} {self.unit}"
        what = "a whole number" if self.kind is int else "a number"
        return f"{what} from {self.range} {self.unit}".rstrip()

    def check(self, value: object, key: str | None = None) -> Value:
        """Return `value` as this parameter's kind; an int is valid for a float, nothing else is converted.

        Raise InputError, naming `key`, if it is of another type, not finite, out of range or not a choice.
        """
        checked = self._convert(value)
        if checked is None:
            raise InputError(f"{key or self.name} = {format_value(value)}: expected {self.expected}")
        return checked

    def _convert(self, value: object) -> Value | None:
        converted = _text(value) if self.kind is str else _real(value, whole=self.kind is int)
        size = len(converted) if isinstance(converted, str) else converted
        if converted is None or size is None or not self.low <= size <= self.high:  # also refuses NaN
            return None
        if self.choices and converted not in self.choices:
            return None
        if self.form[0] and converted and not re.fullmatch(self.form[0], str(converted)):
            return None
        return self.kind(converted)


def _text(value: object) -> str | None:
    # A lone surrogate cannot be encoded as UTF-8.
    if not isinstance(value, str) or any("\ud800" <= char <= "\udfff" for char in value):
        return None
    return value


def _real(value: object, *, whole: bool) -> float | None:
    if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
        return None
    return int(value) if isinstance(value, Integral) else float(value)


def format_number(value: float) -> str:
    """Return a number without a needless fraction: 600, not 600.0."""
    return str(int(value)) if math.isfinite(value) and value == int(value) else repr(value)


def check_items(kind: type[_T], values: Iterable[object], key: str, *, most: int) -> tuple[_T, ...]:
    """Return values as a tuple; raise InputError if one is not a `kind` or there are more than `most`."""
    items = []
    for value in values:
        if not isinstance(value, kind):
            raise InputError(f"{key}: expected {kind.__name__} values, got {format_value(value)}")
        items.append(value)
    if len(items) > most:
        raise InputError(f"{len(items)} {key}: expected at most {most}")
    return tuple(items)


def parameter_table(*parameters: Parameter) -> Mapping[str, Parameter]:
    """Return parameters by name."""
    return MappingProxyType({parameter.name: parameter for parameter in parameters})


def check_values(
    values: Mapping[str, object], table: Mapping[str, Parameter], where: str, prefix: str
) -> dict[str, Value]:
    """Return checked values of a table; `where` names it and `prefix` its keys in errors."""
    for name, value in values.items():
        if name not in table:
            raise unknown_key(name, value, table, where)
    return {name: table[name].check(value, f"{prefix}{name}") for name, value in values.items()}


def defaults(table: Mapping[str, Parameter]) -> dict[str, Value]:
    """Return the default of each parameter, by name."""
    return {name: parameter.default for name, parameter in table.items()}
