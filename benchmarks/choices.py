"""Other methods for what the kernels compute, error against time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial, partialmethod
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import StructuredArray
from sketchterrain.benchmarks import splines
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import NoiseGrid, central_keys, open_ground
from sketchterrain.benchmarks.plotting import Curves, draw_curves
from sketchterrain.benchmarks.report import Row, Table
from sketchterrain.benchmarks.splines import ARCS
from sketchterrain.benchmarks.timing import TimedContext, alternate, spread
from sketchterrain.geometry.lattice import QUADS, level_step, metres_per_unit
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.layers.layer import WorldSettings
from sketchterrain.terrain.layers.points import PackedFeatures, PointsLayer
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    Reals = npt.NDArray[np.floating[Any]]

GROUND, _DESERT = "valley_river", "desert_mountains"
SUBJECTS: Mapping[str, str] = {
    "octaves": "octaves left out: heights at full detail, mm",
    "splines": "distance to a spline, mm",
    "normals": "normals of noise 100 m high, degrees",
    "precision": "heights against NumPy float64, mm",
    "tile size": "size of a tile: heights against float64 kernels, mm",
    "culling": "features left out of tiles too early: heights, mm",
}
"""What each choice is about, with the error's unit."""

CELLS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Cell sizes, m, that octaves are cut off for."""

_LEVEL = 6
_WIDE_LEVEL = 4  # of tiles that lie among dunes too
_RELIEF = 100.0  # m, of the noise whose normals are measured
_FINER_BITS = (12, 10, 8)  # of the distance between differences' vertices, lattice units: 1, 1/4 and 1/16 m
_SPLINE_CELL = 2.0
_SPLINES = 64  # of each kind
_QUADS = (8, 16, 32, 64, 128)
_SHARES = (0.8, 0.6, 0.5, 0.4)

_HEADINGS = {"ns": "ns a point"}


@dataclass(frozen=True)
class _Method:
    """One way to do something: what it is called, its work, points and largest error."""

    name: str
    work: Callable[[], object]
    points: int
    error: Callable[[], float]
    chosen: bool = False
    context: TimedContext | None = None  # another than usual


def table(context: TimedContext, effort: Effort) -> Table:
    """Measure every way of every choice."""
    recipe = open_ground(GROUND, context).recipe
    rows: list[Row] = []
    for subject, methods in (
        ("octaves", _octaves(recipe, context, effort)),
        ("normals", _normals(context, effort)),
        ("precision", _precisions(recipe, context, effort)),
        ("tile size", _tile_sizes(recipe, context, effort)),
        ("culling", _shares(open_ground(_DESERT, context).recipe, context, effort)),
    ):
        rows += _rows(context, subject, list(methods), effort.rounds)
    rows += _splines(context, effort)
    order = list(SUBJECTS)
    rows.sort(key=lambda row: order.index(str(row["subject"])))
    return Table("Other ways", tuple(rows), _HEADINGS)


def _rows(context: TimedContext, subject: str, methods: list[_Method], rounds: int) -> Iterator[Row]:
    works = {each.name: partial((each.context or context).lap, each.work) for each in methods}
    laps = alternate(works, rounds=rounds)
    for method in methods:
        seconds = [one.device for one in laps[method.name]]
        yield {
            "subject": subject,
            "choice": method.name,
            "chosen": "yes" if method.chosen else "no",
            "ns": spread(seconds).median / method.points * 1e9,
            "error": method.error(),
            "unit": SUBJECTS[subject],
            "seconds": seconds,
        }


class _Ground:
    """Heights of a square in the middle of the sketch, cut into so many quads a patch."""

    def __init__(self, recipe: TerrainRecipe, count: int, *, quads: int = QUADS, level: int = _LEVEL) -> None:
        self.cell = level_step(level) * metres_per_unit(recipe.extent)
        _, column, row = central_keys(level, count)[0]
        side = int(np.ceil(np.sqrt(count))) * QUADS // quads
        step, first = level_step(level), np.arange(side) * quads
        offsets = np.arange(-1, quads + 2)
        x = ((column * QUADS + first[:, None]) + offsets) * step
        y = ((row * QUADS + first[:, None] + quads) - offsets) * step
        self.x, self.y = np.tile(x, (side, 1)), np.repeat(y, side, axis=0)
        self.points = len(self.x) * (quads + 1) ** 2

    def work(self, evaluator: Evaluator, cell: float | None = None) -> Callable[[], Reals]:
        """Return what evaluates it and returns heights, m."""
        size = self.cell if cell is None else cell
        return lambda: evaluator.surface(self.x, self.y, cell_size=size).height

    def reference(self, recipe: TerrainRecipe) -> Reals:
        """Return the heights in NumPy float64, m."""
        x, y = (axis[:, 1:-1] for axis in (self.x, self.y))
        grids = [np.meshgrid(a, b) for a, b in zip(x, y, strict=True)]
        parts = [
            HostTerrain(recipe).samples(a.ravel(), b.ravel(), cell_size=self.cell).height for a, b in grids
        ]
        return np.stack(parts).reshape(len(x), x.shape[1], x.shape[1])


def _octaves(recipe: TerrainRecipe, context: TimedContext, effort: Effort) -> Iterator[_Method]:
    ground, evaluator = _Ground(recipe, effort.choice_tiles), Evaluator(recipe, context)
    truth = ground.work(evaluator, 0.0)()
    for cell in CELLS:
        work = ground.work(evaluator, cell)
        name = f"cells of {cell:g} m" if cell else "all octaves"
        chosen = 0.5 * ground.cell <= cell <= ground.cell
        yield _Method(name, work, ground.points, partial(_worst, work, truth), chosen)


def _normals(context: TimedContext, effort: Effort) -> Iterator[_Method]:
    side = min(effort.noise_side, 512)
    grid = NoiseGrid(context, side)
    truth = _normal(grid.host_slope())

    def analytic() -> Reals:
        grid.launch_slope()
        return grid.download_slope()

    yield _Method("analytic", grid.launch_slope, side**2, lambda: _angle(_normal(analytic()), truth))
    for bits in _FINER_BITS:
        fine = NoiseGrid(context, side, step_bits=bits)
        launches = 1 if bits == _FINER_BITS[0] else 5

        # Neighbours of a grid are there already; nearer ones are four more evaluations.
        def work(fine: NoiseGrid = fine, launches: int = launches) -> None:
            for _ in range(launches):
                fine.launch()

        name = f"differences, {fine.spacing:g} m"
        yield _Method(name, work, side**2, partial(_difference_error, fine), launches == 1)


def _difference_error(grid: NoiseGrid) -> float:
    grid.launch()
    height, span = grid.download().astype(np.float64), 2 * grid.spacing
    east = (height[1:-1, 2:] - height[1:-1, :-2]) / span
    north = (height[2:, 1:-1] - height[:-2, 1:-1]) / span
    truth = _normal(grid.host_slope()[1:-1, 1:-1])
    return _angle(_normal(np.stack([east, north], axis=-1)), truth)


def _normal(slope: Reals) -> Reals:
    steep = _RELIEF * slope.astype(np.float64)
    normal = np.concatenate([-steep, np.ones((*steep.shape[:-1], 1))], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def _angle(normal: Reals, truth: Reals) -> float:
    chord = np.linalg.norm(normal - truth, axis=-1)
    return float(np.degrees(2 * np.arcsin(chord.max() / 2)))


def _precisions(recipe: TerrainRecipe, context: TimedContext, effort: Effort) -> Iterator[_Method]:
    ground = _Ground(recipe, 1)
    truth, index = ground.reference(recipe), str(context.device.index)
    contexts = {"float32": context, "float32, --fast": TimedContext(index, fast=True)}
    if context.device.has_double:
        contexts["float64"] = TimedContext(index, real="double")
    timed = _Ground(recipe, effort.choice_tiles)
    for name, opened in contexts.items():
        evaluator = Evaluator(recipe, opened)
        error = partial(_worst, ground.work(evaluator), truth)
        yield _Method(name, timed.work(evaluator), timed.points, error, name == "float32", opened)


def _tile_sizes(recipe: TerrainRecipe, context: TimedContext, effort: Effort) -> Iterator[_Method]:
    evaluator = Evaluator(recipe, context)
    device = str(context.device.index)
    exact = TimedContext(device, real="double") if context.device.has_double else context
    truth_of = Evaluator(recipe, exact)
    for quads in _QUADS:
        ground = _Ground(recipe, max(effort.choice_tiles, 4), quads=quads)
        work, truth = ground.work(evaluator), ground.work(truth_of)()
        # What counts are the quads: vertices on borders are evaluated twice.
        points = len(ground.x) * quads**2
        yield _Method(f"{quads} quads", work, points, partial(_worst, work, truth), quads == QUADS)


def _shares(recipe: TerrainRecipe, context: TimedContext, effort: Effort) -> Iterator[_Method]:
    ground = _Ground(recipe, max(effort.choice_tiles, 4), level=_WIDE_LEVEL)
    whole = ground.work(Evaluator(recipe, context))
    truth = whole()
    yield _Method("all of the reach", whole, ground.points, lambda: 0.0, chosen=True)
    for share in _SHARES:
        # The program has no such tolerance: its features are made to end early here.
        with patch.object(PointsLayer, "pack_features", partialmethod(_cut_short, share)):
            work = ground.work(Evaluator(recipe, context))
            work()  # what reaches the ground is found once and kept
        yield _Method(f"{share:.0%} of the reach", work, ground.points, partial(_worst, work, truth))


_PACK_FEATURES = PointsLayer.pack_features


def _cut_short(
    layer: PointsLayer, share: float, features: StructuredArray, world: WorldSettings, cell: float
) -> PackedFeatures:
    """Pack features as if they reached less far."""
    packed = _PACK_FEATURES(layer, features, world, cell)
    return replace(packed, support=packed.support * share)


def _worst(work: Callable[[], Reals], truth: Reals) -> float:
    return float(np.max(np.abs(work().astype(np.float64) - truth))) * 1e3


def _splines(context: TimedContext, effort: Effort) -> Iterator[Row]:
    few = replace(effort, spline_count=min(effort.spline_count, _SPLINES))
    found = splines.measure(context, few)[0].rows
    for row in found:
        if row["cell_size"] == _SPLINE_CELL:
            yield {
                "subject": "splines",
                "choice": row["method"],
                "chosen": "yes" if row["method"] == ARCS else "no",
                "ns": row["ns_per_place"],
                "error": row["worst_mm"],
                "unit": SUBJECTS["splines"],
            }


_UNITS = ("ns a point", "largest error")
_PANEL = Curves("", "ns", {"": "error"}, by="chosen", text="choice", units=_UNITS, joined=False)
draw_choices = partial(draw_curves, "Ways to do the same: error against time", [_PANEL], each="unit")
