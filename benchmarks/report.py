"""Results of benchmarks: tables as text, Markdown and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from rich import box
from rich.table import Table as RichTable

from sketchterrain.io.files import wrap_os_errors, write_atomic

if TYPE_CHECKING:
    from sketchterrain.benchmarks.registry import Benchmark


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


_SIGNIFICANT = 6


@dataclass(frozen=True)
class Report:
    """What was measured in one run."""

    about: Mapping[str, str]
    rounds: int
    outcomes: tuple[tuple[Benchmark, Outcome], ...]

    def json(self) -> str:
        """Return every number, times in seconds included, as JSON; six digits of each count."""
        return json.dumps(
            {
                "format": 1,
                "about": dict(self.about),
                "rounds": self.rounds,
                "benchmarks": [
                    {
                        "name": benchmark.name,
                        "surface": benchmark.surface,
                        "seed": benchmark.seed,
                        "method": benchmark.method,
                        "tables": [
                            {
                                "title": table.title,
                                "rows": [{k: _rounded(v) for k, v in row.items()} for row in table.rows],
                            }
                            for table in outcome.tables
                        ],
                    }
                    for benchmark, outcome in self.outcomes
                ],
            },
            ensure_ascii=False,
            indent=1,
        )

    def page(self, pictures: Mapping[str, Sequence[str]]) -> str:
        """Return the results as a Markdown page."""
        lines = ["# Benchmarks", "", "| | |", "| :--- | :--- |"]
        lines += [f"| {heading} | {text} |" for heading, text in self.about.items()]
        lines += [
            "",
            f"Medians and 95th percentiles of {self.rounds} rounds, after one that is not counted; rivals "
            "are measured in turn within each round. Absolute times are this machine's, and of its other "
            "load; trust ratios within one table.",
            "",
        ]
        for benchmark, outcome in self.outcomes:
            lines += [f"## {benchmark.name}", "", benchmark.method, ""]
            lines += [f"Surface: {benchmark.surface}. Seed: {benchmark.seed}.", ""]
            for picture in pictures.get(benchmark.name, ()):
                lines += [f"![{benchmark.name}]({picture})", ""]
            lines += [markdown(table) for table in outcome.tables]
        return "\n".join(lines)

    def write(self, folder: Path) -> bool:
        """Write bench.md, bench.json and the charts, each whole or not at all."""
        from sketchterrain.benchmarks.charts import available, draw  # charts read the tables of results

        pictures: dict[str, list[str]] = {}
        with wrap_os_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        for benchmark, outcome in self.outcomes:
            for suffix, image in draw(benchmark.name, outcome).items():
                write_atomic(folder / f"{benchmark.name}{suffix}", image)
                if suffix.endswith(".png"):
                    pictures.setdefault(benchmark.name, []).append(f"{benchmark.name}{suffix}")
        write_atomic(folder / "bench.json", (self.json() + "\n").encode())
        write_atomic(folder / "bench.md", self.page(pictures).encode())
        return available()


def _rounded(cell: Cell) -> Cell:
    if isinstance(cell, float):
        return float(f"{cell:.{_SIGNIFICANT}g}")
    if isinstance(cell, (list, tuple)):
        return [float(f"{sample:.{_SIGNIFICANT}g}") for sample in cell]
    return cell
