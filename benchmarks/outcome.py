"""What a benchmark found: tables of raw numbers, with what is needed to show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

Cell: TypeAlias = "str | int | float | Sequence[float] | None"
"""A value: text, a count, a measure, the samples behind it, or nothing."""

Row: TypeAlias = "Mapping[str, Cell]"
"""Values by key; keys that no column names are only in the raw numbers."""


@dataclass(frozen=True)
class Column:
    """A column that is shown: the rows' key, and its heading with the unit."""

    key: str
    heading: str


@dataclass(frozen=True)
class Table:
    """Rows of raw numbers and the columns to show of them."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Outcome:
    """The tables of one benchmark."""

    tables: tuple[Table, ...]


def value_of(row: Row, key: str) -> float:
    """Return a row's number, 0 where there is none."""
    value = row.get(key)
    return float(value) if isinstance(value, (int, float)) else 0.0


def samples_of(row: Row, key: str) -> list[float]:
    """Return a row's samples, none where there are none."""
    value = row.get(key)
    return [float(each) for each in value] if isinstance(value, (list, tuple)) else []
