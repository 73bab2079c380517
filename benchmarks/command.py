"""The ``bench`` command: run the selected benchmarks, print or write their report."""

from __future__ import annotations

import json
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.measure import Measurement
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from sketchterrain.benchmarks.charts import available, draw
from sketchterrain.benchmarks.effort import FULL, QUICK, Effort
from sketchterrain.benchmarks.registry import BENCHMARKS, Benchmark, choose
from sketchterrain.benchmarks.report import Cell, Tables, markdown, terminal
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.export.files import prepare_folder
from sketchterrain.io.files import wrap_os_errors, write_atomic

if TYPE_CHECKING:
    from sketchterrain.compute.device import Device


_PACKAGES = (
    "sketchterrain",
    "numpy",
    "scipy",
    "scikit-image",
    "pyopencl",
    "intel-opencl-rt",
    "pocl-binary-distribution",
)
_SIGNIFICANT = 6  # digits of numbers as JSON


@dataclass(frozen=True)
class Report:
    """What was measured in one run."""

    about: Mapping[str, str]
    rounds: int
    outcomes: tuple[tuple[Benchmark, Tables], ...]

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
                            for table in outcome
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
            lines += [markdown(table) for table in outcome]
        return "\n".join(lines)

    def write(self, folder: Path) -> bool:
        """Write bench.md, bench.json and the charts, each whole or not at all."""
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


def describe(device: Device, *, command: str) -> dict[str, str]:
    """Return what a reader must know to judge the numbers, as headings and texts."""
    return {
        "device": f"{device.name} ({device.type}, {device.compute_units} compute units)",
        "platform": device.platform,
        "driver": f"{device.driver} ({device.version})",
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "packages": ", ".join(f"{name} {found}" for name in _PACKAGES if (found := _version(name))),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": command,
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def run(
    names: Sequence[str],
    *,
    output: Path | None,
    quick: bool,
    device: str | None,
    fast: bool = False,
    as_json: bool,
) -> int:
    """Run benchmarks and show or write their results."""
    chosen = choose(names)
    if output is not None:
        prepare_folder(output)
    effort = QUICK if quick else FULL
    command = _command(chosen, quick=quick, device=device, fast=fast)
    report = _measure(chosen, TimedContext(device, fast=fast), effort, command)
    if output is not None and not report.write(output):
        sys.stderr.write("no charts: matplotlib is not installed; pip install 'sketchterrain[bench]'\n")
    if as_json:
        sys.stdout.write(report.json() + "\n")
    elif output is None:
        _show(report)
    else:
        sys.stdout.write(f"{output / 'bench.md'}\n")
    return 0


def _measure(chosen: Sequence[Benchmark], context: TimedContext, effort: Effort, command: str) -> Report:
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    outcomes = []
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task("", total=len(chosen))
        for benchmark in chosen:
            progress.update(bar, description=benchmark.name)
            outcomes.append((benchmark, benchmark.measure(context, effort)))
            progress.advance(bar)
    return Report(describe(context.device, command=command), effort.rounds, tuple(outcomes))


def _command(chosen: Sequence[Benchmark], *, quick: bool, device: str | None, fast: bool) -> str:
    words = ["sketchterrain", "bench"]
    if len(chosen) < len(BENCHMARKS):
        words += [benchmark.name for benchmark in chosen]
    words += ["--quick"] if quick else []
    words += ["--device", device] if device is not None else []
    words += ["--fast"] if fast else []
    return " ".join([*words, "-o", "DIR"])


def _show(report: Report) -> None:
    console = Console()
    for heading, text in report.about.items():
        console.print(f"[bold]{heading:9}[/bold] {text}", highlight=False)
    for benchmark, outcome in report.outcomes:
        console.print(f"\n[bold]{benchmark.name}[/bold] on {benchmark.surface}", highlight=False)
        for table in outcome:
            shown = terminal(table)
            # A narrow terminal shall break lines rather than words and numbers.
            needed = Measurement.get(console, console.options, shown).minimum
            console.print(shown, width=max(needed, console.width), crop=False, soft_wrap=False)
