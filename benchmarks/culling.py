"""Culling: time a tile as the number of features grows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter

import numpy as np

from sketchterrain.array_types import StructuredArray
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.noise import BARE, BARE_SEED, open_ground
from sketchterrain.benchmarks.plotting import (
    Curves,
    draw_curves,
)
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate, lap, spread
from sketchterrain.generation.terrain import Terrain
from sketchterrain.landforms.placement.feature_types import FEATURE, FEATURE_TYPES
from sketchterrain.terrain.inputs import KernelInputs
from sketchterrain.terrain.layers.dunes import DunesLayer
from sketchterrain.terrain.layers.points import PointFinder
from sketchterrain.terrain.patches import tile_patches
from sketchterrain.terrain.recipe import TerrainRecipe

DENSITY = 25.0
"""Dunes a square kilometre; about ten of them reach a tile."""

_LEVEL = 6
_TILES = 16  # along a side of the square that is looked at

_HEADINGS = {
    "cull_us": "lists on new ground, µs a tile",
    "again_us": "lists on the same ground, µs a tile",
    "near": "features a tile",
}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Microseconds a tile over the number of features in the world, at one density, by the clock.

    Dune fields of 120 to 300 m radius lie anywhere in a square that grows with their number. Each round looks
    at 256 tiles of level 6 around another place of it: the time to list what reaches them, the same again,
    and the time until the tiles stand in a store on the device. The index over all features is built once a
    recipe. Rounds alternate between the sizes.
    """
    worlds = {count: _World(count, context) for count in effort.culling_features}
    laps = alternate({count: world.look for count, world in worlds.items()}, rounds=effort.rounds)
    return (Table("Culling", tuple(_row(worlds[count], laps[count]) for count in worlds), _HEADINGS),)


def _scattered_dunes(count: int) -> tuple[StructuredArray, float]:
    """Return so many dune fields with even ids, and the side of the square that they lie in (m)."""
    rng = np.random.default_rng([BARE_SEED, count])
    side = float(np.sqrt(count / DENSITY)) * 1000.0
    dunes = np.zeros(count, FEATURE)
    dunes["id"], dunes["type"] = 2 * np.arange(count), FEATURE_TYPES.index("dune")
    dunes["x"], dunes["y"] = rng.uniform(0, side, (2, count))
    dunes["radius"], dunes["strength"] = rng.uniform(120, 300, count), rng.uniform(2, 12, count)
    dunes["wavelength"], dunes["wind"] = 100.0, 270.0
    return dunes, side


def _with_dunes(recipe: TerrainRecipe, dunes: StructuredArray) -> TerrainRecipe:
    """Return a recipe with these as its only point features."""
    points = replace(recipe.points, painted=dunes)
    return recipe.with_layers([points, DunesLayer(points.dune_styles)])


@dataclass(frozen=True)
class _Look:
    """Seconds until the lists are there, at the first and at the second look, and features a tile."""

    cull: float
    again: float
    near: float


class _World:
    """A recipe of so many dune fields, and looks at ever new places of it."""

    def __init__(self, count: int, context: TimedContext) -> None:
        bare = open_ground(BARE, context)
        self.count = count
        dunes, self.side = _scattered_dunes(count)
        recipe = _with_dunes(bare.recipe, dunes)
        self._context = context
        self._rng = np.random.default_rng([BARE_SEED, count, 1])
        start = perf_counter()
        PointFinder(recipe.points, recipe.world).painted_near(np.array([[0, 0, 1 << 20, 1 << 20]]))
        self.index = perf_counter() - start
        self._extent = recipe.extent
        self._inputs = KernelInputs(recipe, context)
        self._terrain = Terrain(bare.sketch, recipe, context)
        self.looks: list[_Look] = []

    def look(self) -> Lap:
        """Evaluate tiles around a new place."""
        width = self._extent / 2.0**_LEVEL
        span = max(int(self.side / width) - _TILES, 1)
        first, second = ((int(c), int(r)) for c, r in self._rng.integers(0, span, (2, 2)))
        self.looks.append(self._listed(second))
        keys = [(_LEVEL, first[0] + i, first[1] + j) for j in range(_TILES) for i in range(_TILES)]

        return self._context.lap(lambda: self._terrain.tiles(keys))

    def _listed(self, corner: tuple[int, int]) -> _Look:
        keys = [(corner[0] + i, corner[1] + j) for j in range(_TILES) for i in range(_TILES)]
        patches = tile_patches(_LEVEL, keys, self._extent, up=0)
        blocks, cell = patches.blocks, patches.cell_size
        first, again = (lap(lambda: self._inputs.cull(blocks, cell)).wall for _ in range(2))
        near = len(self._inputs.cull(blocks, cell)["points"].lists["point_list"]) / len(keys)
        return _Look(first, again, near)


def _row(world: _World, laps: Sequence[Lap]) -> Row:
    looks = world.looks[-len(laps) :]
    tiles = _TILES**2
    whole, device = spread([one.wall for one in laps]), spread([one.device for one in laps])
    return {
        "features": world.count,
        "side_km": world.side / 1000,
        "rounds": whole.count,
        "index_ms": world.index * 1e3,
        "cull_us": spread([look.cull for look in looks]).median / tiles * 1e6,
        "again_us": spread([look.again for look in looks]).median / tiles * 1e6,
        "tile_us": whole.median / tiles * 1e6,
        "tile_p95_us": whole.p95 / tiles * 1e6,
        "launch_us": device.median / tiles * 1e6,
        "near": float(np.mean([look.near for look in looks])),
        "seconds": [one.wall for one in laps],
    }


_LINES = {
    "a tile on new ground": "tile_us",
    "of this on the device": "launch_us",
    "lists of what reaches it, on new ground": "cull_us",
    "the same on ground that was looked at": "again_us",
}
_PANEL = Curves("", "features", _LINES, units=("features in the world, at one density", "µs a tile"))
draw_culling = partial(draw_curves, "A tile costs the same in a world of any size", [_PANEL])
