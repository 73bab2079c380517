"""The ``bench`` command: run the selected benchmarks, print or write their report."""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.measure import Measurement
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from sketchterrain.benchmarks.effort import FULL, QUICK, Effort
from sketchterrain.benchmarks.registry import BENCHMARKS, Benchmark, choose
from sketchterrain.benchmarks.report import Report, terminal
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.export.files import prepare_folder

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
        for table in outcome.tables:
            shown = terminal(table)
            # A narrow terminal shall break lines rather than words and numbers.
            needed = Measurement.get(console, console.options, shown).minimum
            console.print(shown, width=max(needed, console.width), crop=False, soft_wrap=False)
