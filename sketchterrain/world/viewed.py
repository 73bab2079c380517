"""A stored world as a renderer sees it: ground out of its pyramid, plants and water from its sketch."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.terrain.lattice import LATTICE_BITS, QUADS, finest_level
from sketchterrain.terrain.plant import PLANT
from sketchterrain.terrain.vertices import FACTS, VertexStore
from sketchterrain.tiles.bounds import meets
from sketchterrain.tiles.codes import code_of
from sketchterrain.world.viewed_features import NOTHING, ViewedFeatures
from sketchterrain.world.viewed_heights import ViewedHeights
from sketchterrain.world.viewed_levels import BARE, ViewedLevels
from sketchterrain.world.viewed_tiles import ViewedTiles

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.render.scene import Sketch
    from sketchterrain.terrain import Terrain
    from sketchterrain.terrain.vertices import VertexMemory
    from sketchterrain.world.opening import StoredWorld

__all__ = ["ViewedWorld"]

_LEAST_BITS: Final = 8
_MOST_BITS: Final = LATTICE_BITS - 1
"""Cells along the longer side of a world that is viewed: powers of two."""


class _NoSketch:
    """In place of a sketch that is not there: all as it is by default."""

    climate: Mapping[str, float] = MappingProxyType({})
    look: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
    weather: Mapping[str, float] = MappingProxyType({})


class ViewedWorld:
    """A stored world as a `~sketchterrain.render.scene.Terrain` that ends.

    Viewing coordinates are metres east and north of its north-west corner, so all of it lies south of the
    origin. A level-0 tile is the least power of two of cells that spans it; so vertices of tiles are stored
    samples, whatever quads they have.

    Parameters
    ----------
    world : StoredWorld
    context : ComputeContext
        Whose memory tiles are written to, and what makes textures.
    terrain : Terrain or None
        Of the world's sketch, for plants and water; None: there are none.
    told : callable or None
        Given a line for each part that cannot be read, and what is known more coarsely is shown there. None:
        that is an error.

    Raises
    ------
    InputError
        If the world has a large grid without coarser ones, or too many cells, or unknown materials.
    """

    def __init__(
        self,
        world: StoredWorld,
        context: ComputeContext,
        terrain: Terrain | None = None,
        *,
        told: Callable[[str], None] | None = None,
    ) -> None:
        self._levels = ViewedLevels(world, told=told)
        self._tiles = ViewedTiles(self._levels)
        finest = self._levels.finest
        across, down = finest.columns - 1, finest.rows - 1
        bits = max(math.ceil(math.log2(max(across, down, 1))), _LEAST_BITS)
        if bits > _MOST_BITS:
            raise InputError(
                f"expected a world of at most {1 << _MOST_BITS} cells a side, got {across}×{down}"
            )
        self._bits = bits
        self._size = across * finest.cell, down * finest.cell
        self._heights = ViewedHeights(self._levels, self._size)
        self._corner = world.west, world.north
        self._context = context
        self._terrain = terrain
        self._features = (
            NOTHING if terrain is None else ViewedFeatures.of(terrain.features, *self._corner, self.bounds)
        )
        self._sketch: Sketch = _NoSketch() if terrain is None else terrain.sketch

    @property
    def context(self) -> ComputeContext:
        """What tiles are written by."""
        return self._context

    @property
    def corner(self) -> tuple[float, float]:
        """Where the viewing coordinates' origin lies, m east and north of the sketch's south-west corner."""
        return self._corner

    @property
    def extent(self) -> float:
        """Width of a level-0 tile (m)."""
        return self.finest_cell * 2.0**self._bits

    @property
    def finest_cell(self) -> float:
        """Metres between vertices of the finest level."""
        return self._levels.finest.cell

    @property
    def size(self) -> tuple[float, float]:
        """Metres from west to east and from south to north."""
        return self._size

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north of the ground in viewing coordinates (m)."""
        return 0.0, -self._size[1], self._size[0], 0.0

    @property
    def sketch(self) -> Sketch:
        """The document; where the world holds none, one that says nothing."""
        return self._sketch

    @property
    def features(self) -> ViewedFeatures:
        """Rivers and lakes; none where the world holds no sketch."""
        return self._features

    @property
    def lacks(self) -> list[str]:
        """A line for each thing that the world does not hold, and what is shown instead."""
        lines = []
        if "normal" not in self._levels.world.layers:
            lines.append("the world holds no normals: they are taken from its heights")
        if "materials" not in self._levels.world.layers:
            lines.append(f"the world holds no materials: all of it is shown as {BARE}")
        if self._terrain is None:
            lines.append("the world holds no sketch: it is shown without plants and water")
        return lines

    def heights(
        self, x: npt.ArrayLike, y: npt.ArrayLike, *, cell_size: float = 0.0
    ) -> npt.NDArray[np.float32]:
        """Return heights (m) at viewing coordinates (m); see `ViewedHeights.at`."""
        return self._heights.at(x, y, cell_size=cell_size)

    def vertex_store(
        self, slots: int, *, quads: int = QUADS, memory: VertexMemory | None = None
    ) -> VertexStore:
        """Return room for so many tiles, for `write_tiles`."""
        return VertexStore(self._context, slots, quads=quads, memory=memory)

    def write_tiles(
        self,
        keys: Sequence[tuple[int, int, int]],
        slots: npt.ArrayLike,
        parents: npt.ArrayLike,
        store: VertexStore,
    ) -> npt.NDArray[np.void]:
        """Write tiles where OpenGL draws them from; parameters and result are those of a terrain's.

        Tiles without ground are not written.

        Raises
        ------
        InputError
            If some of them cannot be read, and nobody is told.
        """
        place = np.asarray(slots, np.int64).reshape(-1)
        roots = np.asarray(parents, np.int64).reshape(-1) < 0
        facts = np.zeros(len(place), FACTS)
        codes = np.array([code_of(*key) for key in keys], np.int64)
        there = np.flatnonzero(meets(codes, self.extent, self.bounds)).tolist()
        coarsest = self._bits - LATTICE_BITS + finest_level(store.quads)
        made = []
        for i in there:
            level, column, row = keys[i]
            made.append(
                self._tiles.tile(coarsest - level, column, row, quads=store.quads, root=bool(roots[i]))
            )
        store.acquire()
        try:
            for i, (tile, known) in zip(there, made, strict=True):
                store.write(int(place[i]), tile)
                facts[i] = known
        finally:
            store.release(place)
        return facts

    def foliage(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.void]:
        """Return the plants in a rectangle of viewing coordinates (m), on the stored ground."""
        if self._terrain is None:
            return np.zeros(0, PLANT)
        return self._planted(self._terrain.foliage(*self._in_world(west, south, east, north)))

    def foliage_steps(
        self, west: float, south: float, east: float, north: float
    ) -> Generator[None, None, npt.NDArray[np.void]]:
        """Find them in steps of a few ms; the last one returns them."""
        if self._terrain is None:
            return np.zeros(0, PLANT)
        found = yield from self._terrain.foliage_steps(*self._in_world(west, south, east, north))
        return self._planted(found)

    def _in_world(
        self, west: float, south: float, east: float, north: float
    ) -> tuple[float, float, float, float]:
        x, y = self._corner
        return west + x, south + y, east + x, north + y

    def _planted(self, plants: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
        """Return plants in viewing coordinates, those that have ground, at its height."""
        moved = plants.copy()
        moved["x"] -= self._corner[0]
        moved["y"] -= self._corner[1]
        west, south, east, north = self.bounds
        there = (moved["x"] >= west) & (moved["x"] <= east) & (moved["y"] >= south) & (moved["y"] <= north)
        moved = moved[there]
        if len(moved):
            moved["z"] = self._heights.at(moved["x"], moved["y"])
        return moved
