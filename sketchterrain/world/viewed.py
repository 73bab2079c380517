"""A stored world as a renderer sees it: ground out of its pyramid, plants and water from its sketch."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.compute import ComputeContext
from sketchterrain.errors import InputError
from sketchterrain.features.catalogue import FEATURE, Lake, River, ShapeField
from sketchterrain.render.scene import Sketch
from sketchterrain.terrain import Terrain
from sketchterrain.terrain.answers import TerrainFeatures
from sketchterrain.terrain.lattice import LATTICE_BITS, QUADS, finest_level
from sketchterrain.terrain.plant import PLANT
from sketchterrain.terrain.vertices import FACTS, VertexMemory, VertexStore
from sketchterrain.tiles.bounds import meets
from sketchterrain.tiles.codes import code_of
from sketchterrain.world.opening import StoredWorld
from sketchterrain.world.stored_pyramid import BARE, StoredPyramid

Bounds = tuple[float, float, float, float]

_LEAST_BITS: Final = 8
_MOST_BITS: Final = LATTICE_BITS - 1
"""Cells along the longer side of a world that is viewed: powers of two."""


class _NoSketch:
    """Stands for a sketch that is not there: all as it is by default."""

    climate: Mapping[str, float] = MappingProxyType({})
    look: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
    weather: Mapping[str, float] = MappingProxyType({})


class StoredTerrain:
    """A stored world as a bounded `~sketchterrain.render.scene.Terrain`.

    Viewing coordinates are metres east and north of its north-west `corner`, so all of it lies south of the
    origin. A level-0 tile is the least power of two of cells that spans it; so vertices of tiles are stored
    samples, whatever quads they have.

    `terrain` is that of the world's sketch; without it there are no plants and no water. `told` is called
    with a line for each part that cannot be read, and what is known more coarsely is shown there; without it
    that is an error. `lacks` has a line for each thing that the world does not hold.

    Raises
    ------
    InputError
        If the world has too many cells, or unknown materials.
    """

    def __init__(
        self,
        world: StoredWorld,
        context: ComputeContext,
        terrain: Terrain | None = None,
        *,
        told: Callable[[str], None] | None = None,
    ) -> None:
        self._pyramid, self._terrain, self.context = StoredPyramid(world, told=told), terrain, context
        finest = world.levels[0]
        across, down = finest.columns - 1, finest.rows - 1
        self._bits = max(math.ceil(math.log2(max(across, down, 1))), _LEAST_BITS)
        if self._bits > _MOST_BITS:
            most = 1 << _MOST_BITS
            raise InputError(f"expected a world of at most {most} cells a side, got {across}×{down}")
        self.corner = world.west, world.north
        self.finest_cell = finest.cell
        self.extent = finest.cell * 2.0**self._bits
        self.size = across * finest.cell, down * finest.cell
        self.bounds: Bounds = (0.0, -self.size[1], self.size[0], 0.0)
        self.sketch: Sketch = _NoSketch() if terrain is None else terrain.sketch
        self.features = TerrainFeatures(np.zeros(0, FEATURE), ())
        if terrain is not None:
            self.features = _moved_features(terrain.features, *self.corner, self.bounds)
        self.heights = self._pyramid.heights
        lacks = {
            "the world holds no normals: they are taken from its heights": "normal" not in world.layers,
            f"the world holds no materials: all of it is shown as {BARE}": "materials" not in world.layers,
            "the world holds no sketch: it is shown without plants and water": terrain is None,
        }
        self.lacks = [line for line, true in lacks.items() if true]

    def vertex_store(
        self, slots: int, *, quads: int = QUADS, memory: VertexMemory | None = None
    ) -> VertexStore:
        """Return room for so many tiles, for `write_tiles`."""
        return VertexStore(self.context, slots, quads=quads, memory=memory)

    def write_tiles(
        self,
        keys: Sequence[tuple[int, int, int]],
        slots: npt.ArrayLike,
        parents: npt.ArrayLike,
        store: VertexStore,
    ) -> npt.NDArray[np.void]:
        """Write tiles where OpenGL draws them from, as a terrain does; not those without ground."""
        place = np.asarray(slots, np.int64).reshape(-1)
        roots = np.asarray(parents, np.int64).reshape(-1) < 0
        facts = np.zeros(len(place), FACTS)
        codes = np.array([code_of(*key) for key in keys], np.int64)
        coarsest = self._bits - LATTICE_BITS + finest_level(store.quads)
        made = []
        for i in np.flatnonzero(meets(codes, self.extent, self.bounds)).tolist():
            level, column, row = keys[i]
            tile, facts[i] = self._pyramid.tile(
                coarsest - level, column, row, quads=store.quads, root=bool(roots[i])
            )
            made.append((int(place[i]), tile))
        store.acquire()
        try:
            for slot, tile in made:
                store.write(slot, tile)
        finally:
            store.release(place)
        return facts

    def foliage(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.void]:
        """Return the plants in a rectangle of viewing coordinates (m), on the stored ground."""
        steps = self.foliage_steps(west, south, east, north)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                found: npt.NDArray[np.void] = end.value
                return found

    def foliage_steps(
        self, west: float, south: float, east: float, north: float
    ) -> Generator[None, None, npt.NDArray[np.void]]:
        """Find them in steps of a few ms; the last one returns them."""
        if self._terrain is None:
            return np.zeros(0, PLANT)
        x, y = self.corner
        found = yield from self._terrain.foliage_steps(west + x, south + y, east + x, north + y)
        plants = found.copy()
        plants["x"] -= x
        plants["y"] -= y
        plants = plants[_within(plants["x"], plants["y"], self.bounds)]
        if len(plants):
            plants["z"] = self.heights(plants["x"], plants["y"])
        return plants


ViewedWorld = StoredTerrain


def _moved_features(features: TerrainFeatures, west: float, north: float, bounds: Bounds) -> TerrainFeatures:
    """Return features about an origin (m), cut off at bounds about that (m)."""
    points = features.points.copy()
    points["x"] -= west
    points["y"] -= north
    reach = points["radius"]
    there = (points["x"] + reach > bounds[0]) & (points["x"] - reach < bounds[2])
    there &= (points["y"] + reach > bounds[1]) & (points["y"] - reach < bounds[3])
    rivers = [part for river in features.rivers for part in _river_parts(river, west, north, bounds)]
    lakes = [_cut_lake(lake, west, north, bounds) for lake in features.lakes]
    return TerrainFeatures(
        points[there], tuple(rivers), tuple(lake for lake in lakes if (lake.shape.inside > 0).any())
    )


def _river_parts(river: River, west: float, north: float, bounds: Bounds) -> Iterator[River]:
    """Return the parts of a river within bounds: from the first point within to the last one."""
    line = river.centreline - np.array([west, north, 0.0])
    inside = _within(line[:, 0], line[:, 1], bounds)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if last - first > 1:
            width = np.ascontiguousarray(river.centreline_width[first:last])
            yield replace(river, centreline=np.ascontiguousarray(line[first:last]), centreline_width=width)


def _cut_lake(lake: Lake, west: float, north: float, bounds: Bounds) -> Lake:
    """Return a lake whose distance field is cut by the distance to a border of bounds."""
    field = lake.shape
    rows, columns = field.inside.shape
    x = field.west - west + np.arange(columns) * field.spacing
    y = field.south - north + np.arange(rows) * field.spacing
    across, down = np.minimum(x - bounds[0], bounds[2] - x), np.minimum(y - bounds[1], bounds[3] - y)
    inside = np.minimum(field.inside, np.minimum(across[None, :], down[:, None])).astype(np.float32)
    return replace(lake, shape=ShapeField(float(x[0]), float(y[0]), field.spacing, inside))


def _within(x: npt.NDArray[Any], y: npt.NDArray[Any], bounds: Bounds) -> npt.NDArray[np.bool_]:
    return np.asarray((x >= bounds[0]) & (y >= bounds[1]) & (x <= bounds[2]) & (y <= bounds[3]))
