"""One thing that a person can set: what it is called, which values it takes, how a wrong one is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any, TypeAlias, TypeVar

from sketchterrain.errors import InputError
from sketchterrain.sketch.wording import did_you_mean, format_value

Value: TypeAlias = int | float | str

_T = TypeVar("_T")

Properties: TypeAlias = Mapping[str, Any]
"""Values by the names of their parameters, each of the kind that its parameter declares."""


@dataclass(frozen=True)
class Parameter:
    """One thing that a person can set."""

    name: str
    kind: type[int] | type[float] | type[str]
    default: Value
    low: float
    high: float
    unit: str
    help: str
    choices: tuple[Value, ...] = ()
    form: tuple[str, str] = ("", "")

    @property
    def range(self) -> str:
        """The allowed values in words, for example ``"0 to 1"``."""
        if self.choices:
            return " or ".join(repr(choice) for choice in self.choices)
        if self.form[1]:
            return self.form[1]
        return f"{format_number(self.low)} to {format_number(self.high)}"

    @property
    def expected(self) -> str:
        """What an error says was expected, for example ``"a number from 1 to 9000 m"``."""
        if self.choices or self.form[1]:
            return self.range
        if self.kind is str:
            return f"a text of {self.range} {self.unit}"
        what = "a whole number" if self.kind is int else "a number"
        return f"{what} from {self.range} {self.unit}".rstrip()

    def check(self, value: object, key: str | None = None) -> Value:
        """Return `value` as this parameter's kind.

        A whole number is welcome where a number is expected; nothing else is converted.
        """
        checked = self._convert(value)
        if checked is None:
            raise InputError(f"{key or self.name} = {format_value(value)}: expected {self.expected}")
        return checked

    def _convert(self, value: object) -> Value | None:
        converted = _text(value) if self.kind is str else _real(value, whole=self.kind is int)
        size = len(converted) if isinstance(converted, str) else converted
        if converted is None or size is None or not self.low <= size <= self.high:  # so is NaN refused
            return None
        if self.choices and converted not in self.choices:
            return None
        if self.form[0] and converted and not re.fullmatch(self.form[0], str(converted)):
            return None
        return self.kind(converted)


def _text(value: object) -> str | None:
    # A lone surrogate has no UTF-8 and so no place in a file.
    if not isinstance(value, str) or any("\ud800" <= char <= "\udfff" for char in value):
        return None
    return value


def _real(value: object, *, whole: bool) -> float | None:
    if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
        return None
    return int(value) if isinstance(value, Integral) else float(value)


def format_number(value: float) -> str:
    """Return a number as a person writes it: 600, not 600.0."""
    return str(int(value)) if math.isfinite(value) and value == int(value) else repr(value)


def check_items(kind: type[_T], values: Iterable[object], key: str, *, most: int) -> tuple[_T, ...]:
    """Return values that all have to be of one kind."""
    kept = []
    for value in values:
        if not isinstance(value, kind):
            raise InputError(f"{key}: expected {kind.__name__} values, got {format_value(value)}")
        kept.append(value)
    if len(kept) > most:
        raise InputError(f"{len(kept)} {key}: expected at most {most}")
    return tuple(kept)


def parameter_table(*parameters: Parameter) -> Mapping[str, Parameter]:
    """Return parameters by their names."""
    return MappingProxyType({parameter.name: parameter for parameter in parameters})


def find_parameter(table: Mapping[str, Parameter], name: str, value: object, where: str) -> Parameter:
    """Return the parameter `name` of a table."""
    if name not in table:
        raise InputError(
            f"unknown key {format_value(name)} = {format_value(value)} in {where}: expected "
            f"{', '.join(table)}{did_you_mean(name, table)}"
        )
    return table[name]
