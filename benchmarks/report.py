"""Results of benchmarks: tables as text and Markdown."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from rich import box
from rich.table import Table as RichTable

Cell: TypeAlias = "str | int | float | Sequence[float] | None"
"""A value: text, a count, a measure, the samples behind it, or nothing."""

Row: TypeAlias = "Mapping[str, Cell]"
"""Values by key; keys that no column names are only in the raw numbers."""


_UNITS = {"us": "µs", "mb": "MB", "gb": "GB", "deg": "°"} | {
    each: each for each in ("ms", "s", "mm", "km", "px")
}
_WORDS = {"p50": "median", "p90": "90 %", "p95": "95 %", "p99": "99 %", "us": "µs"}
_HEADINGS = {
    "cell": "cell, m",
    "cell_size": "cell, m",
    "texel": "texel, m",
    "megabytes": "most memory, MB",
    "difference": "difference, ΔE",
}


@dataclass(frozen=True)
class Table:
    """Rows of numbers by key, shown under headings: given ones, or what the key says, as in ``p95_ms``."""

    title: str
    rows: tuple[Row, ...]
    headings: Mapping[str, str] = field(default_factory=dict)
    hidden: Container[str] = ()

    @property
    def keys(self) -> list[str]:
        """Keys that are shown: of all but samples, in the rows' order."""
        every = {key: None for row in self.rows for key in row if key not in self.hidden}
        samples = {key for row in self.rows for key, cell in row.items() if isinstance(cell, (list, tuple))}
        return [key for key in every if key not in samples]

    def heading(self, key: str) -> str:
        """Return a key's heading, with its unit."""
        if key in self.headings or key in _HEADINGS:
            return self.headings.get(key) or _HEADINGS[key]
        *words, last = [_WORDS.get(word, word) for word in key.split("_")]
        if last in _UNITS and words:
            return f"{' '.join(words)}, {_UNITS[last]}"
        return " ".join([*words, last])


Tables: TypeAlias = "tuple[Table, ...]"
"""The tables of one benchmark."""


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
    numeric = [_is_numeric(table, key) for key in table.keys]
    lines = [
        f"### {table.title}",
        "",
        _line(map(table.heading, table.keys)),
        _line("---:" if right else ":---" for right in numeric),
    ]
    lines += [_line(shown(row.get(key)) for key in table.keys) for row in table.rows]
    return "\n".join(lines) + "\n"


def terminal(table: Table) -> RichTable:
    """Return a table for rich to print."""
    result = RichTable(title=table.title, title_justify="left", box=box.SIMPLE_HEAD)
    for key in table.keys:
        heading, right = table.heading(key), _is_numeric(table, key)
        texts = [heading, *(shown(row.get(key)) for row in table.rows)]
        widest = max(len(word) for text in texts for word in text.split())
        result.add_column(heading, justify="right" if right else "left", min_width=widest)
    for row in table.rows:
        result.add_row(*(shown(row.get(key)) for key in table.keys))
    return result


def _is_numeric(table: Table, key: str) -> bool:
    return not any(isinstance(row.get(key), str) for row in table.rows)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
