"""From a sketch to a terrain: recipes built and rebuilt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.array_types import Bounds, Float64Array, LatticeArray, StructuredArray
from sketchterrain.caching import LRUCache
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.material_rules import resolved_rules
from sketchterrain.hydrology.rivers import trace_hydrology
from sketchterrain.placement.covers import create_covers
from sketchterrain.placement.fill import Fill
from sketchterrain.placement.placement import place
from sketchterrain.placement.plateaus import create_plateaus
from sketchterrain.placement.sea import create_sea
from sketchterrain.terrain.balance import solve_strengths
from sketchterrain.terrain.centrelines import valley_radius
from sketchterrain.terrain.changes import difference
from sketchterrain.terrain.edits import EditedPoints, apply_fill_edits, apply_painted_edits
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.layers import layer_stack
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.layers.dunes import DunesLayer
from sketchterrain.terrain.layers.lakes import LakesLayer
from sketchterrain.terrain.layers.layer import WorldSettings
from sketchterrain.terrain.layers.plateaus import PlateausLayer
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.terrain import Terrain

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

# Rivers follow the terrain at this coarse cell size, without its small features.
_CELLS_PER_EXTENT = 256
_MAX_CACHED = 2**31  # lattice units: farther positions are not cached


@dataclass(frozen=True, eq=False)
class _CachedHeights:
    """Cached heights of one recipe."""

    recipe: TerrainRecipe  # without rivers and lakes
    key: LatticeArray  # (n,) positions, ascending
    height: Float64Array  # (n,), m


class DryTerrain:
    """Heights of a recipe's terrain without rivers and lakes; each position is evaluated once.

    Heights of positions that no change affects come from the cache, where the last recipe's have a name; the
    bits are the same.
    """

    def __init__(self, recipe: TerrainRecipe, memory: LRUCache, name: str) -> None:
        self._recipe = recipe
        self._terrain = HostTerrain(recipe)
        self._memory = memory
        self._name = name
        self._cell = recipe.extent / _CELLS_PER_EXTENT
        self._requested: LatticeArray = np.zeros(0, dtype=np.int64)
        self._key: LatticeArray | None = None  # until the first request
        self._height = np.zeros(0)

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return heights (m) at positions (m), shape (n,)."""
        east, north = (to_lattice(each, self._recipe.extent) for each in (x, y))
        if len(east) == 0:
            return np.zeros(0)
        if max(np.abs(east).max(), np.abs(north).max()) >= _MAX_CACHED:
            return self._terrain.heights(east, north, cell_size=self._cell)
        if self._key is None:
            self._key, self._height = self._still_valid(self._memory.get(self._name))
        key, inverse = np.unique((east << 32) + north, return_inverse=True)
        row = np.minimum(np.searchsorted(self._key, key), max(len(self._key) - 1, 0))
        cached = self._key[row] == key if len(self._key) else np.zeros(len(key), dtype=np.bool_)
        height = np.zeros(len(key))
        height[cached] = self._height[row[cached]]
        if not cached.all():
            at = _unpack_keys(key[~cached])
            height[~cached] = self._terrain.heights(*at, cell_size=self._cell)
            merged = np.concatenate([self._key, key[~cached]])
            order = np.argsort(merged)
            self._key = merged[order]
            self._height = np.concatenate([self._height, height[~cached]])[order]
        self._requested = np.union1d(self._requested, key)
        return np.asarray(height[inverse])

    def store(self) -> None:
        """Store the requested heights for the next recipe and drop all others."""
        if self._key is None:
            return
        row = np.searchsorted(self._key, self._requested)
        self._memory.store(self._name, _CachedHeights(self._recipe, self._requested, self._height[row]))

    def _still_valid(self, last: _CachedHeights | None) -> tuple[LatticeArray, Float64Array]:
        """Return positions, ascending, and heights that no change affects."""
        change = None if last is None else difference(last.recipe, self._recipe)
        if last is None or change is None:
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        valid = np.ones(len(last.key), dtype=np.bool_)
        east, north = _unpack_keys(last.key)
        unit = self._recipe.world.unit
        for box in change.areas:
            west, south, right, top = np.array(box) / unit + [-1, -1, 1, 1]
            valid &= (east < west) | (east > right) | (north < south) | (north > top)
        return last.key[valid], last.height[valid]


def _unpack_keys(key: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
    """Return positions by their keys: x in the high half, signed y in the low half."""
    north = (key & 0xFFFFFFFF).astype(np.uint32).view(np.int32).astype(np.int64)
    return (key - north) >> 32, north


def build(
    sketch: Sketch,
    *,
    seed: int | None = None,
    device: str | ComputeContext | None = None,
    memory: LRUCache | None = None,
) -> Terrain:
    """Place a sketch's features and open a device; no part of the terrain is computed yet.

    Parameters
    ----------
    sketch
    seed
        Overrides the sketch's own.
    device
        An open :class:`~sketchterrain.compute.context.ComputeContext`, or a selector as for
        :func:`~sketchterrain.compute.device.choose_device`.
    memory
        Cache of earlier terrains built in this thread, of any sketch; it saves time.

    Raises
    ------
    DeviceError
        If there is no such device.
    """
    context = device if isinstance(device, ComputeContext) else ComputeContext(device)
    if seed is not None:
        sketch = sketch.replace(seed=seed)
    memory = LRUCache() if memory is None else memory
    return Terrain(sketch, make_recipe(sketch, memory=memory), context, memory=memory)


def rebuild(
    terrain: Terrain, sketch: Sketch, *, checkpoint: Callable[[], None] = lambda: None
) -> tuple[Terrain, list[Bounds]]:
    """Return the terrain of a changed sketch on the same device, and the areas where it may differ.

    Cached placement is reused; the bits are those of `build`. Only tiles that the areas touch have changed,
    see :func:`~sketchterrain.terrain.changes.changed_areas`. ``checkpoint`` is as for `make_recipe`.
    """
    return terrain.updated(sketch, make_recipe(sketch, memory=terrain.memory, checkpoint=checkpoint))


def make_recipe(
    sketch: Sketch, *, memory: LRUCache | None = None, checkpoint: Callable[[], None] = lambda: None
) -> TerrainRecipe:
    """Place the features of a sketch, in plain NumPy without a device.

    Edits come between placing and filling, so that the fill avoids moved features. Rivers come last: they
    follow the terrain that the other features form. ``memory`` caches earlier recipes, of any sketch; the
    bits are the same. ``checkpoint`` is called between steps; it may raise to cancel, which leaves the cache
    valid.
    """
    memory = LRUCache() if memory is None else memory
    placed = place(sketch, seed=sketch.seed, cache=memory, checkpoint=checkpoint)
    painted = apply_painted_edits(placed, sketch.edits)
    fill = Fill.from_sketch(sketch, painted.points, seed=sketch.seed, cache=memory)
    adopted = apply_fill_edits(fill, sketch.edits, size=sketch.size)
    world = WorldSettings(sketch.extent, sketch.seed, sketch.fidelity)
    dry = TerrainRecipe(
        world,
        sketch.climate,
        layer_stack(
            extent=sketch.extent,
            ground=sketch.ground,
            painted=painted.points,
            fill=replace(fill, replaced=adopted.replaced),
            covers=create_covers(sketch, cache=memory),
            sea=create_sea(sketch, cache=memory),
        ),
        sketch.material_table,
        resolved_rules(sketch.material_rules),
    )
    checkpoint()
    solved = _solved_features(dry, painted, memory, checkpoint)
    points = replace(dry.points, painted=np.concatenate([solved, adopted.points]))
    dry = dry.with_layers([points, DunesLayer(points.dune_styles)])
    # Heights depend on neither covers nor material rules.
    bare = replace(dry.with_layers([CoversLayer(())]), climate={}, material_rules=())
    borders = DryTerrain(bare, memory, "heights at borders")
    plateaus = PlateausLayer(create_plateaus(sketch, borders, memory))
    borders.store()
    terrain = DryTerrain(bare.with_layers([plateaus]), memory, "dry heights")
    waters = trace_hydrology(sketch, seed=sketch.seed, ground=terrain, cache=memory, checkpoint=checkpoint)
    terrain.store()
    radii = [valley_radius(*each) for each in zip(waters.rivers, waters.grounds, strict=True)]
    corridors = CorridorsLayer.of(waters.rivers, radii, sketch.extent, memory)
    return replace(
        dry.with_layers([plateaus, LakesLayer(waters.lakes), corridors]),
        resolutions=waters.resolutions,
        orphans=(*painted.orphans, *adopted.orphans, *waters.orphans),
    )


def _solved_features(
    dry: TerrainRecipe, edited: EditedPoints, memory: LRUCache, checkpoint: Callable[[], None]
) -> StructuredArray:
    """Return the features with solved strengths, and locked ones with their own."""
    requested = dry.with_layers([replace(dry.points, painted=edited.unlocked)])
    solved = solve_strengths(requested, locked=edited.lock_only, memory=memory, checkpoint=checkpoint)
    points = edited.points.copy()
    points["strength"] = np.where(edited.locked, points["strength"], solved["strength"])
    return points
