"""How much of what the device can do at most noise and tiles reach, both measured in one run."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.grounds import BARE, central_keys, open_ground
from sketchterrain.benchmarks.noise import OCTAVES, NoiseGrid
from sketchterrain.benchmarks.outcome import Column, Row, Table
from sketchterrain.benchmarks.timing import alternate, spread
from sketchterrain.document.parameters import MATERIALS
from sketchterrain.terrain.kernel_arguments import KernelArguments
from sketchterrain.terrain.lattice import QUADS
from sketchterrain.terrain.patch_layout import tile_patches
from sketchterrain.terrain.patches import PatchLauncher
from sketchterrain.terrain.surfaces import SurfaceStore

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext

OPERATIONS = 97
"""Of an octave of simplex noise at a point, whole and real, as a compiler counts them; loads are none."""

LEVEL = 5  # of tiles
_FILE = "baselines/roofline.cl"
_CHAINS = 8  # of the kernels
_OPERATING = (("one by one", "roof_operate", 1), ("in eights", "roof_operate_eights", 8))
_REAL = 4
_TILES = 256
_VERTEX = _REAL * (4 + len(MATERIALS))  # height and normal, weights
# Values, work items, and rounds of each: milliseconds on a processor, enough for a graphics card.
_SIZES = {"CPU": (1 << 24, 1 << 17, 256), "GPU": (1 << 28, 1 << 22, 1024)}

_COLUMNS = (
    Column("work", "work"),
    Column("items", "points"),
    Column("median_ms", "median, ms"),
    Column("million_per_s", "M points/s"),
    Column("bytes", "bytes a point"),
    Column("operations", "operations a point"),
    Column("gigabytes_per_s", "GB/s"),
    Column("giga_operations_per_s", "G operations/s"),
    Column("bound", "bound by"),
    Column("share", "share of the roofline"),
)


def table(context: TimedContext, effort: Effort) -> Table:
    """Measure the roof and what stands under it, in turn."""
    values, items, rounds = _SIZES.get(context.device.type, _SIZES["GPU"])
    grid = NoiseGrid(context, effort.noise_side)
    tiles, octaves, vertices = _bare_tiles(context, min(_TILES, effort.thesis_tiles))
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
        f"tiles of bare ground, {octaves} octaves": (tiles, vertices, _VERTEX, OPERATIONS * octaves),
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
    return Table("Share of the roofline", _COLUMNS, tuple(rows))


def _bare_tiles(context: TimedContext, count: int) -> tuple[Callable[[], object], int, int]:
    """Return what launches tiles without features, their octaves at a vertex, and their vertices."""
    recipe = open_ground(BARE, context).recipe
    arguments, keys = KernelArguments(recipe, context), central_keys(LEVEL, count)
    patches = tile_patches(LEVEL, [key[1:] for key in keys], recipe.extent, up=0)
    ranges = arguments.world(patches.cell_size)["table"].ranges
    octaves = sum(last - first for first, last in (ranges["ground"], ranges["mottle"]))
    launcher, store = PatchLauncher(arguments), SurfaceStore(context, QUADS + 1, count)
    work = partial(launcher.surfaces, patches, store, np.arange(count))
    return work, octaves, count * (QUADS + 1) ** 2
