"""Time of every kernel."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sketchterrain.benchmarks import host
from sketchterrain.benchmarks.appearance_error import AT, GROUND, kernel_drapes, open_appearance
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import BARE, RELIEF, NoiseGrid, central_keys, open_ground
from sketchterrain.benchmarks.poisson_disk import PoissonDisk
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.splines import KERNELS, SplineQueries, splines_and_places
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate, spread
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.lattice import QUADS
from sketchterrain.look.texture_levels import emboss, paint_layer
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.terrain.appearance import Appearance
from sketchterrain.terrain.patches import sample_stride
from sketchterrain.terrain.surfaces import vertex_dtype
from sketchterrain.vegetation.graded_poisson import GradedPoisson, SpacingRaster

_REAL = 4
_POINT_RADIUS = 1 << 14  # lattice units
_POINT_STEP = 1 << 15
_POINT_SIDE = 400.0  # side of the square of points, in distances

WRITTEN: Mapping[str, float] = {
    "patches": 6 * _REAL,  # height, four masks and the mottle
    "points": 5 * _REAL,
    "surfaces": (4 + len(BUILT_IN)) * _REAL,  # height, normal and weights
    "parents": 4
    * _REAL
    * (QUADS + 1) ** 2
    / (QUADS // 2 + 1) ** 2,  # height and normal of nearly four children
    "ground_bytes": _REAL + 3 + len(BUILT_IN),  # height; normal and weights as bytes
    "vertices": vertex_dtype(len(BUILT_IN)).itemsize,
    "facts": 4 * _REAL + _REAL * QUADS / sample_stride(QUADS),  # low, high, whether finite; a strip of errors
    **dict.fromkeys(("throw_first", "throw_one", "throw_two", "throw_four"), 8),  # candidate and time
    "accept": 5,  # point and level
    "inherit": 5,
    "write_points": 17 * 80,  # a piece's points and levels
    **dict.fromkeys(("throw_one_graded", "throw_two_graded", "throw_four_graded"), 16),
    "accept_graded": 12 * 0.04,  # an accepted point
    "list_for_finer": 1 + 16 * 4,  # four points or so
    "clear": 4,
    "count_points": 4,
    "write_graded": 24 * 80,
    "appearance": 4,  # a texel
    "area_means": 4 * _REAL,
    "material_paint": 4 * _REAL,
    "material_relief": 4 * _REAL,
    "bench_fbm": _REAL,
    "bench_write": 4 * _REAL,
    "bench_fbm_slope": 3 * _REAL,
    "bench_base_detail": _REAL,
    **dict.fromkeys(KERNELS.values(), _REAL),
}
"""Bytes that a work item writes, for every kernel in ``kernels/*.cl``."""


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Device time of a launch of every kernel, by profiling events.

    `patches` and `surfaces` evaluate tiles of 64 quads around the middle of the sketch (an item is a vertex;
    `patches` includes a border of one), `parents` derives their parents' values, `ground_bytes` packs them as
    in files, `vertices` writes them for display, `facts` their bounds and errors (an item is a strip of
    quads), `points` evaluates a square grid at the same cell size. `throw_…`, `accept_…` and `inherit` are
    the rounds of Poisson-disk points, `clear` and `list_for_finer` those of graded ones (an item is a cell),
    `count_points` and `write_…` their lists (an item is 256 cells of a row). `bench_fbm` is 8 octaves of
    noise on a grid, `bench_fbm_slope` with slopes, `bench_base_detail` as many of detail below a DEM,
    `appearance` paints a tile of roads among fields, of texels of 0.5 m and of 65 m, for which `area_means`
    sums up fields (an item is a texel, an area), and a tile of 150 draped lines over as many areas,
    `material_paint` and `material_relief` the materials'
    textures (an item is a texel), `spline_…_distances`
    the distance to a spline of six control points, flattened for cells of 1 m. Medians and 95th percentiles
    are over all launches of all rounds; rates are work items, and the bytes that they write, over the median.
    `patches` is padded to groups of 256 items.

    The second table times the loops on the host, which are compiled C.
    """
    works = dict(_works(context, effort))
    laps = alternate({case: partial(context.lap, work) for case, work in works.items()}, rounds=effort.rounds)
    rows = [row for case in works for row in _time_rows(case, laps[case])]
    order = list(WRITTEN)
    rows.sort(key=lambda row: order.index(str(row["kernel"])))
    return Table("Kernels", tuple(rows)), host.times(effort.host_side, effort.rounds)


Work = Callable[[], object]


@dataclass(frozen=True)
class _KernelCase:
    """Which kernels a piece of work is there to time, on which ground and at which tile level."""

    kernels: tuple[str, ...]
    ground: str | None = None
    level: int | None = None


def _works(context: TimedContext, effort: Effort) -> Iterator[tuple[_KernelCase, Work]]:
    names = (BARE, f"{RELIEF}{effort.presets[-1]}", *effort.presets)
    grounds = {name: open_ground(name, context) for name in names}
    for name, terrain in grounds.items():
        for level in effort.kernel_levels:
            keys = central_keys(level, effort.kernel_tiles)
            yield _KernelCase(("patches", "surfaces", "parents"), name, level), partial(terrain.tiles, keys)
            if context.device.has_double:
                packed = partial(_pack, terrain, level, effort.kernel_tiles)
                yield _KernelCase(("ground_bytes",), name, level), packed
            places = np.arange(len(keys)), np.full(len(keys), -1), terrain.vertex_store(len(keys))
            yield _KernelCase(("vertices", "facts"), name, level), partial(terrain.write_tiles, keys, *places)
            yield _KernelCase(("points",), name, level), _points(terrain, level, effort)
    paint = open_appearance(context)
    for level, kernels in ((6, ("appearance",)), (-1, ("appearance", "area_means"))):
        tile = level, *(int(at // (paint.extent / 2.0**level)) for at in AT)
        yield _KernelCase(kernels, GROUND, level), partial(_painted, paint, tile)
    with TemporaryDirectory() as folder:
        drapes = kernel_drapes(context, Path(folder))
        yield _KernelCase(("appearance",), "draped layers"), partial(drapes.tiles, [(0, 0, 0)])
        drapes.tiles([(0, 0, 0)])  # lists it while the file is there
    yield from _point_works(context, round(_POINT_SIDE * _POINT_RADIUS))
    grid = NoiseGrid(context, effort.noise_side)
    yield _KernelCase(("bench_fbm",)), grid.launch
    yield _KernelCase(("bench_fbm_slope",)), grid.launch_slope
    yield _KernelCase(("bench_base_detail",)), grid.detail_launcher()
    items = effort.kernel_points
    out = context.empty(4 * items, context.real_dtype)
    write = partial(context.launch, "baselines/bench_bytes.cl", "bench_write", (items,), out)
    yield _KernelCase(("bench_write",)), write
    yield _KernelCase(("material_paint", "material_relief")), partial(_textures, context, effort)
    drawn = splines_and_places("river", effort.kernel_points // 64, each=64, seed=1)
    queries = SplineQueries(context, *drawn)
    for method, kernel in KERNELS.items():
        yield _KernelCase((kernel,)), queries.work(method, 1.0)


def _point_works(context: TimedContext, side: int) -> Iterator[tuple[_KernelCase, Work]]:
    area = (0, 0, side, side)
    one = PoissonDisk(context, _POINT_RADIUS, seed=1)
    kernels = ("inherit", "throw_first", "throw_one", "throw_two", "throw_four", "accept", "write_points")
    yield _KernelCase(kernels), partial(one.within, area)
    graded = GradedPoisson(context, _even, least=_POINT_RADIUS, most=2 * _POINT_RADIUS, levels=1, seed=1)
    thrown = ("throw_one_graded", "throw_two_graded", "throw_four_graded")
    others = ("clear", "accept_graded", "list_for_finer", "count_points", "write_graded")
    yield _KernelCase((*thrown, *others)), partial(graded.within, area)


def _painted(paint: Appearance, tile: tuple[int, ...]) -> None:
    """Paint a tile without what is known of others."""
    replace(paint, land=replace(paint.land)).tiles([tile])


def _even(west: int, south: int, east: int, north: int) -> SpacingRaster:
    """Return one distance all over a rectangle."""
    step = _POINT_STEP
    column, row = west // step, south // step
    shape = (-(-north // step) - row + 1, -(-east // step) - column + 1)
    return SpacingRaster(column * step, row * step, step, np.full(shape, 1.2 * _POINT_RADIUS, np.float32))


def _pack(terrain: Terrain, level: int, count: int) -> None:
    """Pack as many patches as there are tiles, from the middle of the sketch on."""
    cell = terrain.extent / 2.0**level / QUADS
    across = int(np.sqrt(count))
    size = {"columns": across * QUADS + 1, "rows": across * QUADS + 1}
    middle = terrain.extent / 2
    deque(terrain.window_bytes(middle, middle, cell=cell, left=0, top=0, **size), 0)


def _textures(context: TimedContext, effort: Effort) -> None:
    """Make every texture of materials, of as many texels as other kernels have points, or fewer."""
    side = 1 << (int(np.sqrt(effort.kernel_points)).bit_length() - 1)
    for layer in BUILT_IN.layers.values():
        emboss(context, paint_layer(context, layer.name, side), layer)


def _points(terrain: Terrain, level: int, effort: Effort) -> Work:
    width = terrain.extent / 2.0**level
    _, column, row = central_keys(level, effort.kernel_tiles)[0]
    side = int(np.sqrt(effort.kernel_points))
    step = np.arange(side) * (width * np.ceil(np.sqrt(effort.kernel_tiles)) / side)
    x, y = np.meshgrid(column * width + step, row * width + step)
    return partial(terrain.heights, x, y, cell_size=width / QUADS)


def _time_rows(case: _KernelCase, laps: Sequence[Lap]) -> Iterator[Row]:
    for kernel in case.kernels:
        launches = [launch for lap in laps for launch in lap.launches if launch.kernel == kernel]
        # Parents' bare heights are fewer, and no masks are written for them.
        most = max(launch.items for launch in launches)
        launches = [launch for launch in launches if launch.items == most]
        times = spread([launch.seconds for launch in launches])
        items = int(np.median([launch.items for launch in launches]))
        yield {
            "kernel": kernel,
            "ground": case.ground,
            "level": case.level,
            **times.cells("launches"),
            "items": items,
            "ns_per_item": times.median / items * 1e9,
            "million_items_per_s": items / times.median * 1e-6,
            "gigabytes_per_s": items * WRITTEN[kernel] / times.median * 1e-9,
            "seconds": [launch.seconds for launch in launches],
        }
