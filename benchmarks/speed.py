"""Rates of noise and tiles beside rivals and beside the roofline of the device."""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.benchmarks import thesis
from sketchterrain.benchmarks.baselines.noise import Absent, Rival, in_c, in_fastnoise2, in_numpy
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import BARE, OCTAVES, NoiseGrid, central_keys, open_ground
from sketchterrain.benchmarks.plotting import BarPanel, Curves, draw_bars, draw_curves
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.thesis import LEVEL
from sketchterrain.benchmarks.timing import TimedContext, alternate, lap, spread
from sketchterrain.compute.device import list_devices
from sketchterrain.compute.device_check import is_usable
from sketchterrain.geometry.lattice import QUADS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.terrain.inputs import KernelInputs
from sketchterrain.terrain.patches import PatchLauncher, tile_patches
from sketchterrain.terrain.surfaces import SurfaceStore

OPERATIONS = 97
"""Of an octave of simplex noise at a point, whole and real, as a compiler counts them; loads are none."""
GULLY_OPERATIONS, NODE_OPERATIONS = 290, 90
"""Of an octave of gullies, and of reading the nodes, counted in the source."""

_FILE = "baselines/roofline.cl"
_CHAINS = 8  # of the kernels
_OPERATING = (("one by one", "roof_operate", 1), ("in eights", "roof_operate_eights", 8))
_REAL = 4
_TILES = 256
_VERTEX = _REAL * (4 + len(MATERIALS))  # height and normal, weights
# Values, work items, and rounds of each: milliseconds on a processor, enough for a graphics card.
_SIZES = {"CPU": (1 << 24, 1 << 17, 256), "GPU": (1 << 28, 1 << 22, 1024)}

_HEADINGS = {"share": "share of the roofline"}


def _roofline(context: TimedContext, effort: Effort) -> Table:
    """Measure the roof and what stands under it, in turn."""
    values, items, rounds = _SIZES.get(context.device.type, _SIZES["GPU"])
    grid = NoiseGrid(context, effort.noise_side)
    tiles, octaves, gullies, vertices = _bare_tiles(context, min(_TILES, effort.thesis_tiles))
    out = context.empty(values, context.real_dtype)
    operands = (context.real_dtype.type(0.999), np.int32(rounds), out)
    # Work, points, bytes and operations of each.
    works: dict[str, tuple[Callable[[], object], int, float, float]] = {
        "writing": (partial(context.launch, _FILE, "roof_write", (values,), out), values, _REAL, 0),
        **{
            f"multiplying and adding, {what}": (
                partial(context.launch, _FILE, kernel, (items // width,), *operands),
                items,
                _REAL,
                2 * _CHAINS * rounds,
            )
            for what, kernel, width in _OPERATING
        },
        f"noise, {OCTAVES} octaves": (grid.launch, effort.noise_side**2, _REAL, OPERATIONS * OCTAVES),
        f"tiles of bare ground, {octaves} octaves, {gullies} of gullies": (
            tiles,
            vertices,
            _VERTEX,
            OPERATIONS * octaves + GULLY_OPERATIONS * gullies + NODE_OPERATIONS,
        ),
    }
    laps = alternate(
        {name: partial(context.lap, work) for name, (work, *_) in works.items()}, rounds=effort.rounds
    )
    seconds = {name: [one.device for one in found] for name, found in laps.items()}
    rate = {name: points / spread(seconds[name]).median for name, (_, points, *_) in works.items()}
    # A roof is the best that was seen, not what is usual.
    bandwidth = values * _REAL / min(seconds["writing"])
    quickest = min(min(seconds[f"multiplying and adding, {what}"]) for what, *_ in _OPERATING)
    peak = items * 2 * _CHAINS * rounds / quickest
    rows: list[Row] = []
    for name, (_, points, size, operations) in works.items():
        roofs = {"bytes": bandwidth / size} | ({"operations": peak / operations} if operations else {})
        bound = min(roofs, key=roofs.__getitem__)
        rows.append(
            {
                "work": name,
                "items": points,
                "median_ms": spread(seconds[name]).median * 1e3,
                "million_per_s": rate[name] * 1e-6,
                "bytes": size,
                "operations": operations,
                "gigabytes_per_s": rate[name] * size * 1e-9,
                "giga_operations_per_s": rate[name] * operations * 1e-9,
                "bound": bound,
                "share": rate[name] / roofs[bound],
                "seconds": seconds[name],
            }
        )
    return Table("Share of the roofline", tuple(rows), _HEADINGS)


def _bare_tiles(context: TimedContext, count: int) -> tuple[Callable[[], object], int, int, int]:
    """Return what launches tiles of bare ground, its octaves of noise and of gullies, and their vertices."""
    recipe = open_ground(BARE, context).recipe
    inputs, keys = KernelInputs(recipe, context), central_keys(LEVEL, count)
    patches = tile_patches(LEVEL, [key[1:] for key in keys], recipe.extent, up=0)
    ranges = inputs.sampling(patches.cell_size).octaves.ranges
    octaves, gullies = (
        sum(last - first for first, last in map(ranges.__getitem__, names))
        for names in (("bend_u", "bend_v", "detail", "mottle"), ("gully",))
    )
    launcher, store = PatchLauncher(inputs), SurfaceStore(context, QUADS + 1, count, len(recipe.materials))
    work = partial(launcher.surfaces, patches, store, np.arange(count))
    return work, octaves, gullies, count * (QUADS + 1) ** 2


ASKED: Mapping[str, float] = {"FastNoise2": 1.0, "NumPy": 25.0}
"""How many times as fast as each rival the first device shall be."""

_RIVALS = (in_c, in_fastnoise2, in_numpy)

_QUICK = 0.2  # s a lap
_MORE = 4  # times as many rounds of quick laps

_NOISE_HEADINGS = {
    "ours_over_it": "the first row is so many times as fast",
    "difference": "largest difference from the first row",
}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Compare median times of this program and of others that do the same, in alternating rounds.

    Noise: float32 simplex fBm of 8 octaves in two dimensions on a square grid, by the clock from call to the
    last value in memory. This program's kernel runs on the selected device and on every CPU device, the
    others with as many threads as the process may use. C and NumPy compute the same sum; FastNoise2
    sums gradient noise on the same kind of lattice with its own hash and gradients. Methods below 0.2 s have
    four times as many rounds again. Processor time counts all threads; NumPy has one. Missing programs are
    listed with how to install them.

    Tiles: 64 quads, heights and normals, against a re-implementation of the thesis's method (permutation
    table, all octaves at every level, iterated sampling of splines, a launch a tile, finite differences), by
    the clock to the end of the last launch, the tiles left on the device. This program's also carry material
    weights; its heights and normals alone are a separate row. Errors are those of heights against each
    method's own float64 build, this program's with rivers as arcs for the finest cells, the thesis's with
    splines sampled 64 times in 5 rounds. The ratios that count are those to the thesis's fastest variant
    whose error is no larger than this program's, or to its most accurate one: by the error of 99 % of the
    vertices, and by the largest (Zaaijer 2013, section 3.4).

    Roofline: the most that the selected device can write, and multiply and add without contraction, by small
    kernels in the same run; noise and bare tiles as shares of the lower of the two bounds of their bytes and
    operations. A processor computes integers in parallel with reals, so noise can pass its bound.
    """
    return _noise(context, effort), thesis.table(context, effort), _roofline(context, effort)


@dataclass(frozen=True)
class _TimedMethod:
    name: str
    threads: int
    run: Callable[[], object]
    result: Callable[[], npt.NDArray[Any]]


def _noise(context: TimedContext, effort: Effort) -> Table:
    side = effort.noise_side
    grid = NoiseGrid(context, side)
    problem = grid.problem(len(os.sched_getaffinity(0)))
    found = [make(problem) for make in _RIVALS]
    rivals = [one for one in found if isinstance(one, Rival)]
    others = (_TimedMethod(one.name, one.threads, one.run, one.run) for one in rivals)
    methods = [*_kernels(context, side), *others]
    works = {method.name: partial(lap, method.run) for method in methods}
    laps = alternate(works, rounds=effort.rounds, quick=_QUICK, more=_MORE)
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
                **times.cells(),
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
    return Table(f"Noise: simplex fBm, {OCTAVES} octaves, {side}²", tuple(rows), _NOISE_HEADINGS)


def _kernels(context: TimedContext, side: int) -> Iterator[_TimedMethod]:
    """Yield the chosen device, then every other CPU device."""
    others = [d for d in list_devices() if d.type == "CPU" and d != context.device and is_usable(d)]
    for opened in (context, *(TimedContext(str(device.index)) for device in others)):
        grid = NoiseGrid(opened, side)
        device = opened.device
        run = partial(_once, grid)
        yield _TimedMethod(f"this program, {device.platform}", device.compute_units, run, grid.download)


def _once(grid: NoiseGrid) -> None:
    grid.launch()
    grid.finish()


_RATES = [BarPanel("", "million points × octaves a second", {"rate": "million_octaves_per_s"})]
draw_rates = partial(
    draw_bars, "Simplex fBm of 8 octaves, the same threads for all but NumPy", _RATES, ("method",)
)
_UNITS = ("µs a tile", "error of 99 %, mm")
_PANEL = Curves("", "us_per_tile", {"": "error_mm"}, text="method", units=_UNITS, joined=False)
draw_thesis = partial(draw_curves, "Tiles against the thesis's method", [_PANEL], each="ground")
