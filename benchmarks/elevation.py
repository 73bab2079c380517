"""Elevation: exactness, error bounds, time and seams of patchworks of DEM grids."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sketchterrain.benchmarks import detail
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.elevation_seams import generated_heights, patchwork, seam_tables
from sketchterrain.benchmarks.elevation_terrain import flight, flight_table, tile_times
from sketchterrain.benchmarks.large_dem import write_large_dem
from sketchterrain.benchmarks.report import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import TimedContext, lap, spread
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.selection import Patchwork

SEED = 1

_STEP = 10.0  # m: Puget Sound's, as in the paper
_ERRORS = (0, 0.5, 1, 2, 3, 4, 5, 7, 10, 15, 20, 25, 30, 40, 50, 70, 100, 150, 200, 300)  # m
_PAPER = {1024: 0.75, 4096: 11.73, 16384: 196.2}  # s, one core of a Core i5 of 2.67 GHz
_PAPER_QUERIES = {50.0: 800.0, 0.0: 55.0}
_QUERIES = 200

_BOUNDS = (
    Column("error", "e, m"),
    Column("patches", "patches"),
    Column("most", "largest error, m"),
    Column("rms", "rms, m"),
    Column("overlap", "patches at a point, mean"),
    Column("overlap_most", "most"),
    Column("histogram", "points with 1, 2, … patches, %"),
)
_BUILDS = (
    Column("side", "side, samples"),
    Column("total_s", "in memory, s"),
    Column("paper_s", "paper, bilinear, s"),
    Column("patches", "patches"),
    Column("add_s", "adding a grid of 1024², s"),
)
_STORES = (
    Column("side", "side, samples"),
    Column("build_s", "file to store, s"),
    Column("megabytes", "most memory, MB"),
    Column("open_ms", "opening, ms"),
    Column("far_ms", "1,000 patches at 50 m, ms"),
    Column("together_ms", "1,000 finest ones side by side"),
    Column("apart_ms", "anywhere"),
    Column("add_s", "adding a grid of 1024², s"),
    Column("bytes", "bytes a sample"),
    Column("overhead", "over float32, %"),
    Column("beside_finest", "over the finest level, %"),
)
_RATES = (
    Column("side", "side, samples"),
    Column("error", "e, m"),
    Column("patches", "patches"),
    Column("queries", "queries a second"),
    Column("paper", "paper's"),
    Column("surface_ms", "surface, ms"),
    Column("rows", "points by rows, M/s"),
    Column("random", "at random, M/s"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Patchworks of generated DEM grids (Rocca, Panozzo & Puppo 2012), times in seconds beside the paper's.

    The ground is noise whose amplitudes fall as k^-1.9, in steps of 10 m, with a deviation of 600 m. Errors
    are those at all samples of one grid; queries are uniform covers of all of it. Times of building are
    medians; the paper's are those of one core, Puget Sound and bilinear patches, ours of bicubic ones. Seams
    are those of `elevation_seams`. Stores are those of `write_large_dem`, each in a process of its own, whose
    memory is counted beyond that of its libraries; patches are read from files that are not in the system's
    memory. Tiles are those of a preset with and without its data, in turn; flights are over DEMs of the same
    sizes.

    Detail: real DEMs (matplotlib's, those of the folder SKETCHTERRAIN_DEMS) as truth, cut to a quarter and
    an eighth by means; their patches with the detail that the law of the cut grid alone asks for, beside fBm
    that has a gain of 1/2 and one rms, the same share of the resolution for all grids, that suits all best.
    Exponents of spectra are fitted from four samples of the cut to three of the truth. Means and the largest
    deviation of lattices of octaves that are shifted by parts of an octave.
    """
    sides = effort.elevation_sides
    return Outcome(
        (
            Table("Exactness and bound", _BOUNDS, tuple(_bounds(sides[0]))),
            Table("Building", _BUILDS, tuple(_build(each, effort.rounds) for each in sides)),
            Table("Stores on disk", _STORES, tuple(_store(each) for each in sides)),
            Table("Queries and evaluation", _RATES, tuple(_rates(sides[0]))),
            tile_times(context, effort),
            flight_table(tuple(_flight(context, each) for each in sides)),
            *seam_tables(effort),
            detail.table(effort.detail_lattices),
        )
    )


def _flight(context: TimedContext, side: int) -> Row:
    with TemporaryDirectory(prefix="sketchterrain-") as folder:
        return flight(context, write_large_dem(Path(folder) / "dem.tif", side), side)


def _grid(side: int, place: tuple[float, ...] | None = None, seed: int = SEED) -> ElevationGrid:
    at: Any = place or (_STEP, 0.0, 0.0, 0.0, -_STEP, _STEP * (side - 1))
    return ElevationGrid(generated_heights(side, seed), at)


def _bounds(side: int) -> list[Row]:
    grid = _grid(side)
    work = patchwork(grid)
    x, y = grid.to_metres(*np.meshgrid(np.arange(float(side)), np.arange(float(side))))
    rows: list[Row] = []
    for error in _ERRORS:
        which = work.cover(float(error))
        surface = work.surface(which)
        found = surface.evaluate(x, y)
        off, count = found.height - grid.samples, found.patches.astype(np.int64)
        shares = 100.0 * np.bincount(count.ravel())[1:] / count.size
        rows.append(
            {
                "error": float(error),
                "patches": len(which),
                "most": float(np.abs(off).max()),
                "rms": float(np.sqrt(np.mean(off * off))),
                "overlap": float(count.mean()),
                "overlap_most": int(count.max()),
                "histogram": ", ".join(f"{share:.2g}" for share in shares),
            }
        )
    return rows


def _build(side: int, rounds: int) -> Row:
    grid = _grid(side)
    patchwork(_grid(64)).tops  # noqa: B018 - compiles
    work, times = patchwork(grid), list[float]()
    for _ in range(rounds):
        times.append(lap(lambda: patchwork(grid).tops).wall)
    far = 0.3 * _STEP * side
    inset = build_patches(_grid(min(side, 1024), (9.0, 4.0, far, 4.0, -9.0, far), SEED + 1))
    return {
        "side": side,
        "total_s": spread(times).median,
        "paper_s": _PAPER.get(side),
        "patches": len(work),
        "add_s": lap(lambda: Patchwork({**work.grids, inset.id: inset}).tops).wall,
    }


def _store(side: int) -> Row:
    with TemporaryDirectory(prefix="sketchterrain-") as folder:
        path = write_large_dem(Path(folder) / "dem.tif", side)
        script = Path(__file__).with_name("stored_dem.py")
        command = [sys.executable, "-P", str(script), str(path), folder]
        done = subprocess.run(command, check=True, capture_output=True)
        row: Row = json.loads(done.stdout)
        return row


def _rates(side: int) -> list[Row]:
    work = patchwork(_grid(side))
    extent = _STEP * (side - 1)
    axis = np.linspace(0.0, extent, 1000)
    lines = tuple(each.ravel() for each in np.meshgrid(axis, axis))
    anywhere = np.random.default_rng(SEED).uniform(0.0, extent, (2, len(lines[0])))
    rows: list[Row] = []
    for error in (50.0, 0.0):
        which = work.cover(error)
        queries = [lap(partial(work.cover, error)).wall for _ in range(_QUERIES)]
        surface = work.surface(which)
        rates = [
            len(x) / 1e6 / min(lap(partial(surface.evaluate, x, y)).wall for _ in range(3))
            for x, y in (lines, anywhere)
        ]
        rows.append(
            {
                "side": side,
                "error": error,
                "patches": len(which),
                "queries": 1.0 / spread(queries).median,
                "paper": _PAPER_QUERIES[error],
                "surface_ms": 1e3 * lap(partial(work.surface, which)).wall,
                "rows": rates[0],
                "random": rates[1],
            }
        )
    return rows
