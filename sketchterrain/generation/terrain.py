"""The terrain object: heights, tiles, rasters, plants and features of a recipe on a device."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, Float32Array, LatticeArray, StructuredArray
from sketchterrain.errors import InputError
from sketchterrain.geometry.lattice import LATTICE_BITS, QUADS, level_step, metres_per_unit, to_lattice
from sketchterrain.landforms.node_raster import NODE_BITS
from sketchterrain.schema.materials import MaterialTable
from sketchterrain.stages.runner import Results
from sketchterrain.terrain.appearance import Appearance
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.painted_land import PaintedLand
from sketchterrain.terrain.rasters import GridWindow, QuantizedBand, bands, quantized_bands, window_bands
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.surfaces import (
    Band,
    Drainage,
    Raster,
    Surface,
    TerrainFeatures,
    Tile,
    VertexMemory,
    VertexStore,
)
from sketchterrain.vegetation.foliage import FoliageSampler
from sketchterrain.vegetation.plants import SPECIES

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.document.sketch import Sketch


class Terrain:
    """A terrain on a device; created by :func:`sketchterrain.build`.

    Attributes
    ----------
    sketch : Sketch
    recipe : TerrainRecipe
    context : ComputeContext
    memory : Results or None
        Results of stages, for the next recipe.
    """

    def __init__(
        self,
        sketch: Sketch,
        recipe: TerrainRecipe,
        context: ComputeContext,
        *,
        memory: Results | None = None,
        evaluator: Evaluator | None = None,
    ) -> None:
        self.memory = memory
        self.sketch = sketch
        self.recipe = recipe
        self.context = context
        self._evaluator = Evaluator(recipe, context) if evaluator is None else evaluator

    @cached_property
    def _foliage(self) -> FoliageSampler:
        return FoliageSampler(self._evaluator)

    def updated(self, sketch: Sketch, recipe: TerrainRecipe) -> tuple[Terrain, list[Bounds]]:
        """Return the terrain of a changed recipe on the same device, and the areas where it may differ.

        Its bits are those of a newly built terrain; everything unchanged is shared. Both stay usable, in one
        thread. Areas are those of :func:`~sketchterrain.terrain.recipe.changed_areas`.
        """
        evaluator, areas = self._evaluator.updated(recipe)
        new = Terrain(sketch, evaluator.recipe, self.context, memory=self.memory, evaluator=evaluator)
        if "appearance" in self.__dict__:
            new.__dict__["appearance"] = self.appearance.updated(new.recipe, new.heights)
        return new, areas

    def release_buffers(self) -> None:
        """Free the device's buffers of surfaces and plants, which the next ones need again."""
        self._evaluator.release_buffers()
        self.__dict__.pop("_foliage", None)

    @property
    def evaluator(self) -> Evaluator:
        """Kernel launches of the recipe, with its buffers on the device."""
        return self._evaluator

    @cached_property
    def appearance(self) -> Appearance:
        """Colour of roads and land use on the ground."""
        return Appearance(PaintedLand(self.recipe, self.context, self.heights))

    @property
    def draped_appearance(self) -> Appearance:
        """`appearance` beneath the draped layers of the sketch."""
        sketch = self.sketch
        if not sketch.drapes:
            return self.appearance
        from sketchterrain.drape.drapes import Drapes  # loads GDAL

        drapes = Drapes.open(sketch.drapes, sketch.frame, sketch.size, self.extent)
        return self.appearance.with_drapes(drapes)

    @property
    def extent(self) -> float:
        """Metres along the sketch's longer side."""
        return self.recipe.extent

    @property
    def size(self) -> tuple[float, float]:
        """Size of the sketch eastward and northward, m."""
        return self.sketch.size

    @property
    def features(self) -> TerrainFeatures:
        """Painted features, fill features inside the sketch, rivers and lakes."""
        return TerrainFeatures.from_recipe(self.recipe, self.size)

    @property
    def sea_level(self) -> float | None:
        """Level of the sea (m); None without one."""
        return self.recipe.sea_level

    def heights(self, x: npt.ArrayLike, y: npt.ArrayLike, *, cell_size: float = 0.0) -> Float32Array:
        """Return heights at any points of the world.

        Parameters
        ----------
        x, y
            Metres east and north of the sketch's south-west corner; shapes that broadcast together.
            Positions are rounded to the lattice (extent/2^24 m).
        cell_size
            Distance between samples (m); finer detail is omitted. 0 is full detail.

        Returns
        -------
        ndarray of float32
            Metres, of the broadcast shape.

        Raises
        ------
        InputError
            If a coordinate is not finite or too far away, or the cell size is negative or not finite.
        """
        if not (np.isfinite(cell_size) and cell_size >= 0):
            raise InputError(f"expected a finite cell_size ≥ 0 (m), got {cell_size}")
        east, north = np.broadcast_arrays(to_lattice(x, self.extent), to_lattice(y, self.extent))
        if east.size == 0:
            return np.zeros(east.shape, np.float32)
        height, _ = self._evaluator.points(east.ravel(), north.ravel(), cell_size=float(cell_size))
        return np.asarray(height.reshape(east.shape), dtype=np.float32)

    def tile(self, level: int, column: int, row: int) -> Tile:
        """Return one tile (see :class:`Tile`); several at once are faster through :meth:`tiles`."""
        return self.tiles([(level, column, row)])[0]

    def tiles(self, keys: Sequence[tuple[int, int, int]]) -> list[Tile]:
        """Return tiles by (level, column, row), in the requested order; one launch per level.

        Raises
        ------
        InputError
            If a level is not between −12 and 18.
        """
        tiles: dict[tuple[int, int, int], Tile] = {}
        for level in sorted({key[0] for key in keys}):
            of_level = [key for key in dict.fromkeys(keys) if key[0] == level]
            surface, bounds = self._evaluator.tiles([key[1:] for key in of_level], level)
            tiles |= {key: self._tile(key, surface, float(bounds[i]), i) for i, key in enumerate(of_level)}
        return [tiles[key] for key in keys]

    def vertex_store(
        self, slots: int, *, quads: int = QUADS, memory: VertexMemory | None = None
    ) -> VertexStore:
        """Return slots for tiles as OpenGL draws them, with 32, 64, 128 or 256 quads along a side.

        ``memory`` is that of the vertices; None allocates a buffer on the device.
        """
        return VertexStore(self.context, slots, len(self.materials), quads=quads, memory=memory)

    def write_tiles(
        self,
        keys: Sequence[tuple[int, int, int]],
        slots: npt.ArrayLike,
        parents: npt.ArrayLike,
        store: VertexStore,
    ) -> StructuredArray:
        """Write tiles (level, column, row) into different slots as OpenGL draws them, and wait for them.

        Levels go from −12 to the store's finest, 18 for 64 quads. ``parents`` are the parents' slots, written
        before or by the same call; with −1 a tile is its own parent. InputError: invalid levels or slots.

        Returns
        -------
        structured ndarray, shape (tiles,)
            ``low`` and ``high``: the lowest and highest height of a tile's vertices, own and parent's (m).
            ``error``: the tile's geometric error δ (m): at the centres of every second quad of every second
            row (of all quads if 32), full detail is within δ of the triangles, but for one in a hundred,
            where it is within 1.5 δ.
        """
        key = np.asarray(keys, np.int64).reshape(-1, 3)
        place = _checked_slots(slots, len(key), store.slots)
        parent = np.asarray(parents, np.int64).reshape(-1)
        if parent.size != place.size or np.any(parent < -1) or np.any(parent >= store.slots):
            raise InputError(f"expected a parent's slot for each tile, 0 … {store.slots - 1} or -1")
        return self._evaluator.vertices.write(key, place, parent, store)

    def raster(self, longer_side: int, *, progress: Callable[[float], None] | None = None) -> Raster:
        """Return the whole sketch as one grid.

        Parameters
        ----------
        longer_side
            Vertices along the sketch's longer side, ≥ 2.
        progress
            Called with the completed share, 0 … 1.

        Raises
        ------
        InputError
            If there are fewer than 2 vertices.
        """
        if longer_side < 2:
            raise InputError(f"expected a size of at least 2 vertices, got {longer_side}")
        east, north = self.size
        cell = self.extent / (longer_side - 1)
        columns, rows = (max(2, round(length / cell) + 1) for length in (east, north))
        parts = [np.empty((rows, columns, *more), np.float32) for more in ((), (3,), (len(self.materials),))]
        area = (0.0, 0.0, east, north)
        for band in bands(self._evaluator, area, columns, rows, cell_size=cell, progress=progress):
            for whole, part in zip(parts, (band.height, band.normal, band.materials), strict=True):
                whole[band.top : band.top + len(part)] = part
        return Raster((east / (columns - 1), north / (rows - 1)), *parts)

    def drainage(self) -> Drainage:
        """Return drainage areas and wetness of the sketch, at the nodes that its ground is drained at.

        Wetness is that of the ground, without that of water, which materials and plants know besides.
        """
        painted = self.recipe[ReliefLayer].painted
        assert painted is not None  # noqa: S101 # as of every sketch
        nodes, spacing = painted.levels[0], self.extent * 2.0 ** (NODE_BITS - LATTICE_BITS)
        columns, rows = (int(length / spacing) + 1 for length in self.size)
        west, south = -nodes.column, -nodes.row
        inside = np.s_[south : south + rows, west : west + columns]
        area, wetness = nodes.area[inside], nodes.wetness[inside]
        return Drainage(spacing, np.ascontiguousarray(area[::-1]), np.ascontiguousarray(wetness[::-1]))

    def grid(
        self,
        west: float,
        south: float,
        east: float,
        north: float,
        *,
        columns: int,
        rows: int,
        cell_size: float | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Iterator[Band]:
        """Return any rectangle of the world as a grid, in bands of rows from the north, in bounded memory.

        No bit of a vertex depends on the bands.

        Parameters
        ----------
        west, south, east, north
            Metres; the outermost vertices are on them.
        columns, rows
            Vertices, ≥ 2 each.
        cell_size
            Distance between samples, m; finer detail is omitted; by default the larger spacing.
        progress
            Called with the completed share, 0 … 1.

        Raises
        ------
        InputError
            If there are fewer vertices, or the rectangle is not finite or inverted.
        """
        spacing = max((east - west) / max(columns - 1, 1), (north - south) / max(rows - 1, 1))
        cell = spacing if cell_size is None else cell_size
        area = (west, south, east, north)
        return bands(self._evaluator, area, columns, rows, cell_size=cell, progress=progress)

    def window(
        self, west: float, north: float, *, cell: float, left: int, top: int, columns: int, rows: int
    ) -> Iterator[Band]:
        """Return a window of an unbounded grid, in bands of rows from the north, in bounded memory.

        No bit of a vertex depends on the window.

        Parameters
        ----------
        west, north
            Position of the grid's vertex (0, 0), m; columns run east, rows south.
        cell
            Metres between vertices; finer detail is omitted.
        left, top
            The window's first column and row.
        columns, rows
            Vertices, ≥ 1 each.

        Raises
        ------
        InputError
            If there are fewer vertices, or they are too far away.
        """
        return window_bands(self._evaluator, GridWindow(west, north, cell, left, top, columns, rows))

    def window_bytes(
        self, west: float, north: float, *, cell: float, left: int, top: int, columns: int, rows: int
    ) -> Iterator[QuantizedBand]:
        """Return the vertices of :meth:`window` with normals and weights quantized to bytes on the device.

        DeviceError is raised for a device without 64-bit floats, InputError as by :meth:`window`.
        """
        return quantized_bands(self._evaluator, GridWindow(west, north, cell, left, top, columns, rows))

    def foliage(
        self, west: float, south: float, east: float, north: float, *, storey: str = "woody"
    ) -> StructuredArray:
        """Return the plants in a rectangle, a function of the world whatever the rectangle.

        Parameters
        ----------
        west, south, east, north
            Metres; west and south inclusive, east and north exclusive.
        storey
            ``"woody"``: trees and shrubs; ``"grass"``: tufts, flowers and ferns, which ignore the trees.

        Returns
        -------
        structured ndarray
            Of dtype :data:`sketchterrain.vegetation.plants.PLANT`, sorted by position: by squares of the
            world, row after row from the south-west, and within each from south to north.

        Raises
        ------
        InputError
            If the rectangle is not finite or inverted, the storey is unknown, or there are too many plants to
            return at once.
        """
        return self._foliage.within((west, south, east, north), storey)

    def foliage_steps(
        self, west: float, south: float, east: float, north: float, *, storey: str = "woody"
    ) -> Generator[None, None, StructuredArray]:
        """Find the plants of :meth:`foliage` in steps of a few ms; the generator returns them."""
        return self._foliage.steps((west, south, east, north), storey)

    def foliage_pieces(
        self, west: float, south: float, east: float, north: float, *, storey: str = "woody"
    ) -> Iterator[StructuredArray]:
        """Return any number of plants in pieces of bounded size; joined they are those of :meth:`foliage`."""
        return self._foliage.pieces((west, south, east, north), storey)

    def foliage_estimate(
        self, west: float, south: float, east: float, north: float, *, storey: str = "woody"
    ) -> tuple[int, int]:
        """Return an upper estimate of the number of plants of :meth:`foliage`, and their bytes."""
        return self._foliage.estimate((west, south, east, north), storey)

    @property
    def material_names(self) -> tuple[str, ...]:
        """Names of the material weights, in order."""
        return self.materials.names

    @property
    def materials(self) -> MaterialTable:
        """The materials of the weights, in order."""
        return self.recipe.materials

    @property
    def species_names(self) -> tuple[str, ...]:
        """Names of the plants' species, in order."""
        return SPECIES

    def _tile(self, key: tuple[int, int, int], surface: Surface, detail: float, i: int) -> Tile:
        level, column, row = key
        cell = level_step(level) * metres_per_unit(self.extent)
        width = cell * QUADS
        bounds = (column * width, row * width, (column + 1) * width, (row + 1) * width)
        parent = surface.parent
        parts = (surface.height, surface.normal, surface.materials, parent[..., 3], parent[..., :3])
        arrays = (np.ascontiguousarray(part[i], dtype=np.float32) for part in parts)
        return Tile(level, column, row, bounds, cell, detail, *arrays)


def _checked_slots(slots: npt.ArrayLike, count: int, limit: int) -> LatticeArray:
    """Return slots as an array; InputError unless there are ``count`` different ones below the limit."""
    place = np.asarray(slots, np.int64).reshape(-1)
    if place.size != count or np.unique(place).size != place.size:
        raise InputError(f"expected {count} different slots, one for each tile")
    if place.size and not (place.min() >= 0 and place.max() < limit):
        raise InputError(f"expected slots 0 … {limit - 1}")
    return place
