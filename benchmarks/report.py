"""A run's results as text and files: bench.md, bench.json, charts."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sketchterrain.benchmarks import charts
from sketchterrain.benchmarks.tables import markdown
from sketchterrain.io.files import wrap_os_errors, write_atomic

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from sketchterrain.benchmarks.outcome import Cell, Outcome
    from sketchterrain.benchmarks.registry import Benchmark

_SIGNIFICANT = 6


@dataclass(frozen=True)
class Report:
    """What was measured in one run.

    Attributes
    ----------
    about : mapping of str to str
        Device, versions, command: see :func:`~sketchterrain.benchmarks.machine.describe`.
    rounds : int
        Measured rounds of each benchmark.
    outcomes : tuple of (Benchmark, Outcome)
    """

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
        """Return the results as a Markdown page.

        Parameters
        ----------
        pictures
            For benchmarks that have charts, their file names.
        """
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
        """Write bench.md, bench.json and the charts, each whole or not at all.

        Returns
        -------
        bool
            Whether there are charts; without matplotlib there are none.

        Raises
        ------
        SketchterrainError
            If the folder can't be made or written to.
        """
        pictures: dict[str, list[str]] = {}
        with wrap_os_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        for benchmark, outcome in self.outcomes:
            for suffix, image in charts.draw(benchmark.name, outcome).items():
                write_atomic(folder / f"{benchmark.name}{suffix}", image)
                if suffix.endswith(".png"):
                    pictures.setdefault(benchmark.name, []).append(f"{benchmark.name}{suffix}")
        write_atomic(folder / "bench.json", (self.json() + "\n").encode())
        write_atomic(folder / "bench.md", self.page(pictures).encode())
        return charts.available()


def _rounded(cell: Cell) -> Cell:
    if isinstance(cell, float):
        return float(f"{cell:.{_SIGNIFICANT}g}")
    if isinstance(cell, (list, tuple)):
        return [float(f"{sample:.{_SIGNIFICANT}g}") for sample in cell]
    return cell
