"""Tiles by the method of Zaaijer 2013: evaluation at equal measured error, and its level-of-detail metric."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.benchmarks.baselines.thesis import SplineSampling, ThesisTiles
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import BARE, TileKey, central_keys, open_ground
from sketchterrain.benchmarks.report import Row, Table
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate, lap, spread
from sketchterrain.compute.context import ComputeContext
from sketchterrain.geometry.lattice import QUADS
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES
from sketchterrain.terrain.inputs import KernelInputs
from sketchterrain.terrain.layers import corridors
from sketchterrain.terrain.noise import FINEST_CELL
from sketchterrain.terrain.patches import PatchLauncher, tile_patches
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.surfaces import SurfaceStore
from sketchterrain.tiles.quadtree import EAST, NORTH, SOUTH, WEST

OURS = "this program"
ALONE = "this program, heights and normals alone"
ASKED = 10.0
"""How many times as fast as the thesis's way at equal error the tiles shall be."""

LEVEL = 5  # of the tiles that are timed
_GROUNDS = (BARE, "valley_river", "alpine_range")
_CONVERGED = SplineSampling(64, 5)
_SAMPLINGS = (SplineSampling(8, 1), SplineSampling(8, 3), SplineSampling(8, 5), SplineSampling(16, 5))
_TRUTH = "converged"
_DOUBLE = ", float64"
_MEASURES = {"error_mm": "of 99 %", "largest_mm": "largest"}
_ERROR_TILES = 16

_HEADINGS = {
    "error_mm": "height error, 99 %, mm",
    "ours_over_it": "this program is so many times as fast",
    "equal": "the thesis's at equal error",
}


def table(context: TimedContext, effort: Effort) -> Table:
    """Measure tiles of bare ground and of valley_river around the middle of the sketch, both ways."""
    exact = TimedContext(str(context.device.index), real="double") if context.device.has_double else None
    rows: list[Row] = []
    for ground in _GROUNDS:
        rows += _rows(ground, context, exact, effort)
    return Table(f"Tiles of level {LEVEL} against the thesis's way", tuple(rows), _HEADINGS)


def _rows(ground: str, context: TimedContext, exact: TimedContext | None, effort: Effort) -> list[Row]:
    terrain = open_ground(ground, context)
    keys = central_keys(LEVEL, effort.thesis_tiles)
    ours, thesis = _Ours(terrain.recipe, context, keys), ThesisTiles(terrain.recipe, context, keys)
    samplings = _SAMPLINGS if terrain.recipe.rivers else _SAMPLINGS[:1]
    alone = _HeightsAlone(terrain.recipe, context, keys)
    works: dict[str, Callable[[], Lap]] = {OURS: partial(lap, ours.launch), ALONE: partial(lap, alone.launch)}
    works |= {_name(one): partial(lap, partial(thesis.launch, one)) for one in samplings}
    if exact is not None:
        double = ThesisTiles(terrain.recipe, exact, keys)
        works |= {_name(one) + _DOUBLE: partial(lap, partial(double.launch, one)) for one in samplings[-1:]}
    laps = alternate(works, rounds=effort.rounds)
    errors = {}
    if exact is not None:
        errors = _errors(terrain.recipe, samplings, context, exact, keys[:: -(-len(keys) // _ERROR_TILES)])
    if errors:
        errors[ALONE] = errors[OURS]  # the same heights, to the bit
    median = {name: spread([one.wall for one in found]).median for name, found in laps.items()}
    equal = {what: _equal(errors, median, key) for key, what in _MEASURES.items()}
    fastest = spread([one.wall for one in laps[OURS]]).median
    least = spread([one.processor for one in laps[OURS]]).median
    rows: list[Row] = []
    for name in works:
        seconds = [one.wall for one in laps[name]]
        times = spread(seconds)
        rows.append(
            {
                "ground": ground,
                "method": name,
                "tiles": len(keys),
                "rounds": times.count,
                "us_per_tile": times.median / len(keys) * 1e6,
                "p95_us_per_tile": times.p95 / len(keys) * 1e6,
                "million_vertices_per_s": len(keys) * (QUADS + 1) ** 2 / times.median * 1e-6,
                **errors.get(name, {}),
                "ours_over_it": times.median / fastest,
                "alone_over_it": times.median / median[ALONE],
                "by_processor": spread([one.processor for one in laps[name]]).median / least,
                "equal": ", ".join(what for what, found in equal.items() if found == name) or None,
                "asked": ASKED if name in equal.values() and terrain.recipe.rivers else None,
                "seconds": seconds,
            }
        )
    return rows


class _Ours:
    """The same tiles by this program's kernels, in one launch of each, left on the device."""

    def __init__(self, recipe: TerrainRecipe, context: ComputeContext, keys: Sequence[TileKey]) -> None:
        self._context = context
        self._launcher = PatchLauncher(KernelInputs(recipe, context))
        self._patches = tile_patches(keys[0][0], [key[1:] for key in keys], recipe.extent, up=0)
        self._store = SurfaceStore(context, QUADS + 1, len(keys), len(recipe.materials))

    def launch(self) -> None:
        """Enqueue the tiles and wait for them."""
        self._launcher.surfaces(self._patches, self._store, np.arange(self._patches.count))
        self._context.download(self._store.ground, 1, self._context.real_dtype)

    def heights(self) -> npt.NDArray[Any]:
        """Return the heights of the last launch, m, shape (tiles, 65, 65)."""
        shape = (self._patches.count, QUADS + 1, QUADS + 1, 4)
        return self._context.download(self._store.ground, shape, self._context.real_dtype)[..., 3]


class _HeightsAlone(_Ours):
    """Their heights and normals without weights of materials: what the thesis's way gives."""

    def launch(self) -> None:
        """Enqueue the tiles and wait for them."""
        patches, real = self._patches, self._context.real_dtype
        found = self._launcher.heights(patches)
        size = (QUADS + 1, QUADS + 1, patches.count)
        span = real.type(0.5 / patches.cell_size)
        given = (found, np.int32(patches.side), span, self._store.ground)
        self._context.launch("baselines/thesis.cl", "normals_of_all", size, *given, group=(QUADS + 1, 1, 1))
        self._context.download(self._store.ground, 1, real)


def _name(sampling: SplineSampling) -> str:
    return f"the thesis's way, {sampling.samples} samples × {sampling.rounds}"


def _errors(
    recipe: TerrainRecipe,
    samplings: Sequence[SplineSampling],
    context: TimedContext,
    exact: TimedContext,
    keys: Sequence[TileKey],
) -> dict[str, dict[str, float]]:
    """Return the errors of each method's heights against its own converged float64 build, for the table."""
    heights = {}
    for opened in (exact, context):
        # Rivers as many short arcs are what this program converges to.
        fine = patch.object(corridors, "tolerance_cell", lambda cell: FINEST_CELL)
        with fine if opened is exact else nullcontext():
            ours = _Ours(recipe, opened, keys)
            ours.launch()
        heights[opened, OURS] = ours.heights()
        thesis = ThesisTiles(recipe, opened, keys)
        for name, sampling in {_TRUTH: _CONVERGED, **{_name(one): one for one in samplings}}.items():
            thesis.launch(sampling)
            heights[opened, name] = thesis.heights()
    errors = {}
    for opened, name in heights:
        if (opened is exact and name == OURS) or name == _TRUTH:
            continue
        truth = heights[exact, OURS if name == OURS else _TRUTH]
        error = np.abs(heights[opened, name].astype(np.float64) - truth) * 1e3
        shown = name + _DOUBLE if opened is exact else name
        errors[shown] = {"error_mm": float(np.percentile(error, 99)), "largest_mm": float(error.max())}
    return errors


def _equal(errors: Mapping[str, Mapping[str, float]], seconds: Mapping[str, float], key: str) -> str | None:
    """Return the thesis's quickest way that errs no more than this program, or its most accurate."""
    theirs = {
        name: error[key] for name, error in errors.items() if name in seconds and not name.startswith(OURS)
    }
    if not theirs:
        return None
    good = [name for name, error in theirs.items() if error <= errors[OURS][key]]
    return min(good, key=seconds.__getitem__) if good else min(theirs, key=theirs.__getitem__)


PLAIN = 1.0
"""F where no feature is near."""


class ThesisTile(NamedTuple):
    """A tile's place in the quadtree, and on which sides it lies at a coarser one (bits of a border case)."""

    level: int
    col: int
    row: int
    case: int


class Disc(NamedTuple):
    """Where a feature makes F larger."""

    x: float
    y: float
    radius: float
    factor: float


@dataclass(frozen=True)
class ThesisView:
    """The metric's settings."""

    extent: float
    quads: int
    tessellation: float
    finest_cell: float = 0.2
    discs: tuple[Disc, ...] = ()

    @property
    def finest(self) -> int:
        """The level at which splitting ends."""
        return max(0, int(np.floor(np.log2(self.extent / self.quads / self.finest_cell) + 1e-9)))

    def tiles(self, eye: Sequence[float], ground: float) -> list[ThesisTile]:
        """Return the tiles that cover the world for a view, coarse ones first."""
        found: list[ThesisTile] = []
        splits = self._splits(np.asarray(eye, np.float64), ground)
        there = np.ones((1, 1), np.bool_)
        for level, split in enumerate(splits):
            case = _coarser(there)
            for row, col in np.argwhere(there & ~split).tolist():
                found.append(ThesisTile(level, col, row, int(case[row, col])))
            there = _doubled(split)
        return found

    def _splits(self, eye: Float64Array, ground: float) -> list[BoolArray]:
        """Return for each level which of its tiles, [row, column], are split."""
        splits: list[BoolArray] = []
        for level in range(self.finest + 1):
            parent = _doubled(splits[-1]) if splits else np.ones((1, 1), np.bool_)
            wanted = parent & (level < self.finest)
            if wanted.any():
                width = self.extent / 2**level
                longest = np.sqrt(self._distance(eye, ground, level)) / (
                    self.tessellation * self._factors[level]
                )
                wanted &= width / self.quads > longest
            splits.append(wanted)
        # A tile can be split only where all its neighbours are there.
        for level in range(self.finest, 0, -1):
            needed = splits[level].copy()
            needed[1:] |= splits[level][:-1]
            needed[:-1] |= splits[level][1:]
            needed[:, 1:] |= splits[level][:, :-1]
            needed[:, :-1] |= splits[level][:, 1:]
            splits[level - 1] |= _halved(needed)
        return splits

    def _distance(self, eye: Float64Array, ground: float, level: int) -> Float64Array:
        width = self.extent / 2**level
        corners = np.arange(2**level) * width
        dx, dy = (np.maximum(np.maximum(corners - at, at - corners - width), 0.0) for at in eye[:2])
        return np.asarray(np.sqrt(dx[None, :] ** 2 + dy[:, None] ** 2 + (eye[2] - ground) ** 2))

    @cached_property
    def _factors(self) -> tuple[Float64Array, ...]:
        """F of each level's tiles."""
        factors = []
        for level in range(self.finest + 1):
            width = self.extent / 2**level
            corners = np.arange(2**level) * width
            factor = np.full((2**level, 2**level), PLAIN)
            for disc in self.discs:
                dx, dy = (np.maximum(np.maximum(corners - at, at - corners - width), 0.0) for at in disc[:2])
                reached = dx[None, :] ** 2 + dy[:, None] ** 2 < disc.radius**2
                factor[reached] = np.maximum(factor[reached], disc.factor)
            factors.append(factor)
        return tuple(factors)


def feature_discs(recipe: TerrainRecipe, factor: float) -> tuple[Disc, ...]:
    """Return painted mountains and pieces of rivers as discs of one factor."""
    mountains = recipe.points.painted[recipe.points.painted["type"] == FEATURE_TYPES.index("mountain")]
    discs = [Disc(float(f["x"]), float(f["y"]), float(f["radius"]), factor) for f in mountains]
    for river in recipe.rivers:
        line, reach = river.points[:, :2], 4.0 * float(np.max(river.width))
        apart = np.linalg.norm(np.diff(line, axis=0), axis=1)
        for (x, y), length in zip((line[1:] + line[:-1]) / 2, apart, strict=True):
            discs.append(Disc(float(x), float(y), length / 2 + reach, factor))
    return tuple(discs)


def _doubled(flags: BoolArray) -> BoolArray:
    """Return the children's flags: each its parent's."""
    return np.asarray(flags.repeat(2, axis=0).repeat(2, axis=1))


def _halved(flags: BoolArray) -> BoolArray:
    """Return the parents' flags: set where one of a parent's children is."""
    side = len(flags) // 2
    return np.asarray(flags.reshape(side, 2, side, 2).any(axis=(1, 3)))


def _coarser(there: BoolArray) -> npt.NDArray[np.int64]:
    """Tell on which sides of a level's tiles, rows from south to north, none of this level is."""
    case = np.zeros(there.shape, np.int64)
    case[:-1] |= np.where(there[1:], 0, NORTH)
    case[1:] |= np.where(there[:-1], 0, SOUTH)
    case[:, 1:] |= np.where(there[:, :-1], 0, WEST)
    case[:, :-1] |= np.where(there[:, 1:], 0, EAST)
    return case
