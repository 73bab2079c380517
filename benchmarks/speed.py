"""The program against its rivals, in one run: noise, and tiles against the thesis's way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.benchmarks import roofline, thesis_tiles
from sketchterrain.benchmarks.baselines import c_noise, fastnoise2, numba_noise, numpy_noise
from sketchterrain.benchmarks.baselines.problem import Absent, Rival
from sketchterrain.benchmarks.noise import OCTAVES, NoiseGrid
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import TimedContext, alternate, lap, spread
from sketchterrain.compute.device import list_devices
from sketchterrain.compute.device_check import is_usable
from sketchterrain.io.system import cpu_count

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import numpy.typing as npt

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import Lap

ASKED: Mapping[str, float] = {"FastNoise2": 1.0, "numba, a point": 8.0, "NumPy": 25.0}
"""How many times as fast as each rival the first device shall be."""

_RIVALS = (
    c_noise.rival,
    fastnoise2.rival,
    numba_noise.rival,
    numba_noise.by_rows,
    numpy_noise.rival,
)

_QUICK = 0.2  # s a lap
_MORE = 4  # times as many rounds of quick laps

_COLUMNS = (
    Column("method", "method"),
    Column("threads", "threads"),
    Column("rounds", "rounds"),
    Column("median_ms", "median, ms"),
    Column("p95_ms", "95 %, ms"),
    Column("million_octaves_per_s", "M points × octaves/s"),
    Column("ours_over_it", "the first row is so many times as fast"),
    Column("by_processor", "by processor time"),
    Column("asked", "asked"),
    Column("difference", "largest difference from the first row"),
    Column("note", "note"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Compare times of this program and of others that do the same, in one run, in turn; medians.

    Noise: float32 simplex fBm of 8 octaves in two dimensions on a square grid, by the clock from call to
    the last value in memory. This program's kernel runs on the chosen device and on every CPU device, with
    the settings that give the same bits everywhere; the others with as many threads as the process may use.
    C, numba and NumPy compute the same sum, numba as one writes it and in the C loop's order, which its
    compiler turns into vectors; FastNoise2 sums gradient noise on the same kind of lattice with its own
    hash and gradients. Those that take less than 0.2 s have four times as many rounds again. By processor
    time too, of all threads of the process, which others disturb less; NumPy has one thread. What is not on
    the machine is named, with how to get it.

    Tiles: 64 quads, heights and normals, against a re-implementation of the thesis's way (permutation
    table, all octaves at every level, iterated sampling of splines, a launch a tile, finite differences),
    both by the clock from the first launch to the end of the last, the tiles left on the device. This
    program's carry weights of materials too; its heights and normals alone stand beside them. Each method's
    error is that of its heights against its own float64 build, this program's with rivers as arcs for the
    finest cells, the thesis's with the nearest place on each spline sampled 64 times in 5 rounds. The
    ratios that count are those to the thesis's quickest way whose error is no larger than this program's,
    or to its most accurate one where none is: by the error of 99 % of the vertices, and by the largest,
    since a single wrong distance shows (Zaaijer 2013, section 3.4).

    Roofline: the most that the chosen device can write, and multiply and add without contraction, by small
    kernels in the same run; noise and tiles without features as shares of the lower of the two bounds that
    their bytes and the operations of their octaves set; a processor computes whole numbers beside real
    ones, so that noise can pass its bound. By profiling events.
    """
    tables = (_noise(context, effort), thesis_tiles.table(context, effort), roofline.table(context, effort))
    return Outcome(tables)


@dataclass(frozen=True)
class _Method:
    name: str
    threads: int
    lap: Callable[[], Lap]
    result: Callable[[], npt.NDArray[Any]]


def _noise(context: TimedContext, effort: Effort) -> Table:
    side = effort.noise_side
    grid = NoiseGrid(context, side)
    problem = grid.problem(cpu_count())
    found = [make(problem) for make in _RIVALS]
    methods = [*_kernels(context, side), *(_method(one) for one in found if isinstance(one, Rival))]
    works = {method.name: method.lap for method in methods}
    laps = alternate(works, rounds=effort.rounds)
    # Laps of milliseconds are disturbed most, and cost least to have more of.
    quick = {name: works[name] for name, found in laps.items() if found[0].wall < _QUICK}
    for name, more in alternate(quick, rounds=_MORE * effort.rounds).items():
        laps[name] += more
    first = methods[0].result()
    rows: list[Row] = []
    for method in methods:
        seconds = [one.wall for one in laps[method.name]]
        times = spread(seconds)
        # Slow methods are compared with the rounds that they took part in.
        shared = laps[methods[0].name][: len(seconds)]
        fastest = spread([one.wall for one in shared]).median
        least = spread([one.processor for one in shared]).median
        same = not method.name.startswith("FastNoise2")
        rows.append(
            {
                "method": method.name,
                "threads": method.threads,
                "rounds": times.count,
                "median_ms": times.median * 1e3,
                "p95_ms": times.p95 * 1e3,
                "million_octaves_per_s": side**2 * OCTAVES / times.median * 1e-6,
                "ours_over_it": times.median / fastest,
                "by_processor": spread([one.processor for one in laps[method.name]]).median / least,
                "asked": next((v for k, v in ASKED.items() if method.name.startswith(k)), None),
                "difference": float(np.max(np.abs(method.result() - first))) if same else None,
                "note": None if same else "another noise: its own hash and gradients",
                "seconds": seconds,
            }
        )
    rows += [
        {
            "method": one.name,
            "asked": next((v for k, v in ASKED.items() if one.name.startswith(k)), None),
            "note": f"absent: {one.reason}",
        }
        for one in found
        if isinstance(one, Absent)
    ]
    return Table(f"Noise: simplex fBm, {OCTAVES} octaves, {side}²", _COLUMNS, tuple(rows))


def _kernels(context: TimedContext, side: int) -> Iterator[_Method]:
    """Yield the chosen device, then every other CPU device."""
    others = [d for d in list_devices() if d.type == "CPU" and d != context.device and is_usable(d)]
    for opened in (context, *(TimedContext(str(device.index)) for device in others)):
        grid = NoiseGrid(opened, side)
        device = opened.device
        yield _Method(
            f"this program, {device.platform}",
            device.compute_units,
            partial(lap, partial(_once, grid)),
            grid.download,
        )


def _method(rival: Rival) -> _Method:
    return _Method(rival.name, rival.threads, lambda: lap(rival.run), rival.run)


def _once(grid: NoiseGrid) -> None:
    grid.launch()
    grid.finish()
