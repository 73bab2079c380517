"""Results of benchmarks: tables as text and Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from rich import box
from rich.table import Table as RichTable

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
    """Return a row's number, 0 if it is missing."""
    value = row.get(key)
    return float(value) if isinstance(value, (int, float)) else 0.0


def samples_of(row: Row, key: str) -> list[float]:
    """Return a row's samples, none where there are none."""
    value = row.get(key)
    return [float(each) for each in value] if isinstance(value, (list, tuple)) else []


_DIGITS = 3
_NOTHING = "–"


def shown(cell: Cell) -> str:
    """Return a value as a person reads it: three digits that count, no exponent from 0.001 to a million."""
    if cell is None:
        return _NOTHING
    if not isinstance(cell, float):
        return str(cell)
    if cell == 0 or not math.isfinite(cell):
        return f"{cell:g}"
    if not 1e-3 <= abs(cell) < 1e6:
        return f"{cell:.{_DIGITS - 1}e}"
    decimals = max(0, _DIGITS - 1 - math.floor(math.log10(abs(cell))))
    return f"{cell:.{decimals}f}"


def markdown(table: Table) -> str:
    """Return a table in Markdown, under its title; numbers are set to the right."""
    numeric = [_is_numeric(table, column.key) for column in table.columns]
    lines = [
        f"### {table.title}",
        "",
        _line(column.heading for column in table.columns),
        _line("---:" if right else ":---" for right in numeric),
    ]
    lines += [_line(shown(row.get(column.key)) for column in table.columns) for row in table.rows]
    return "\n".join(lines) + "\n"


def terminal(table: Table) -> RichTable:
    """Return a table for rich to print."""
    result = RichTable(title=table.title, title_justify="left", box=box.SIMPLE_HEAD)
    for column in table.columns:
        right = _is_numeric(table, column.key)
        widest = max(
            len(word) for row in [column.heading, *_texts(table, column.key)] for word in row.split()
        )
        result.add_column(column.heading, justify="right" if right else "left", min_width=widest)
    for row in table.rows:
        result.add_row(*(shown(row.get(column.key)) for column in table.columns))
    return result


def _texts(table: Table, key: str) -> list[str]:
    return [shown(row.get(key)) for row in table.rows]


def _is_numeric(table: Table, key: str) -> bool:
    return not any(isinstance(row.get(key), str) for row in table.rows)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
