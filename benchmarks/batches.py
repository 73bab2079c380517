"""Terrains a minute: a batch beside one `generate` after the other, each in a fresh process."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import run_program

if TYPE_CHECKING:
    from sketchterrain.benchmarks.timing import TimedContext

SKETCH: Final = "valley_river"

_HEADINGS = {"jobs": "at once"}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Terrains a minute by the clock: `batch` beside `generate`, once a seed in a fresh process.

    Seeds of valley_river with all files, and without the preview; batches of one and of two terrains in work
    at once. Every process is started anew, and its start counts; one run of each before the first round fills
    the drivers' caches. The ways take turns: in each round some seeds one by one, then the batches, of other
    seeds in each round. A ratio is of one round's times; the median of rounds is shown.
    """
    device = ["--device", str(context.device.index), *(["--fast"] if context.fast else [])]
    common = ["--size", str(effort.batch_size), "--json", *device]
    variants = [
        (files, [] if files == "all" else ["--no-preview"], jobs)
        for files in effort.batch_files
        for jobs in effort.batch_jobs
    ]
    rounds: dict[tuple[str, int], list[tuple[float, float]]] = {
        (files, jobs): [] for files, _, jobs in variants
    }
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(effort.batch_rounds + 1):  # the first one only warms up
            warm = turn == 0
            alone, together = (1, 1) if warm else (effort.batch_fresh, effort.batch_seeds)
            first = 1 + turn * max(alone, together)
            fresh: dict[str, float] = {}
            for number, (files, words, jobs) in enumerate(variants):
                place = Path(folder) / f"{turn}-{number}"
                if files not in fresh:
                    fresh[files] = _one_by_one(first, alone, place, [*common, *words]) / alone
                took = _batch(first, together, jobs, place, [*common, *words]) / together
                if not warm:
                    rounds[files, jobs].append((fresh[files], took))
    rows = [_row(files, jobs, effort.batch_seeds, rounds[files, jobs]) for files, _, jobs in variants]
    title = f"{SKETCH}, {effort.batch_size} vertices along a side, {effort.batch_fresh} one by one"
    return (Table(title, tuple(rows), _HEADINGS),)


def _row(files: str, jobs: int, seeds: int, rounds: Sequence[tuple[float, float]]) -> Row:
    fresh, batch = np.array(rounds).T
    ratio = fresh / batch
    return {
        "files": files,
        "jobs": jobs,
        "seeds": seeds,
        "fresh_seconds": fresh.tolist(),
        "batch_seconds": batch.tolist(),
        "fresh_per_minute": round(60.0 / float(np.median(fresh)), 2),
        "batch_per_minute": round(60.0 / float(np.median(batch)), 2),
        "ratio": round(float(np.median(ratio)), 2),
        "worst_ratio": round(float(ratio.min()), 2),
    }


def _one_by_one(first: int, count: int, folder: Path, words: Sequence[str]) -> float:
    start = time.perf_counter()
    for seed in range(first, first + count):
        run_program(["generate", SKETCH, "-o", str(folder / f"alone-{seed}"), "--seed", str(seed), *words])
    return time.perf_counter() - start


def _batch(first: int, count: int, jobs: int, folder: Path, words: Sequence[str]) -> float:
    seeds = f"{first}-{first + count - 1}"
    start = time.perf_counter()
    run_program(["batch", SKETCH, "-o", str(folder / "batch"), "--seeds", seeds, "--jobs", str(jobs), *words])
    return time.perf_counter() - start
