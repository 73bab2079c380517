"""Terrain interfaces of the renderer, and height maps of square regions."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.terrain.appearance import Appearance
from sketchterrain.terrain.surfaces import TerrainFeatures, VertexMemory, VertexStore
from sketchterrain.tiles.stream import QUADS

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.document.sketch import Sketch


class TileSource(Protocol):
    """Terrain that writes tiles into vertex memory; see `sketchterrain.terrain.Terrain`."""

    @property
    def extent(self) -> float:
        """Width of a level-0 tile (m)."""

    @property
    def context(self) -> ComputeContext:
        """Compute context of the terrain."""

    @property
    def sketch(self) -> Sketch:
        """The document."""

    def vertex_store(
        self, slots: int, *, quads: int = QUADS, memory: VertexMemory | None = None
    ) -> VertexStore:
        """Return storage for tiles."""

    def write_tiles(
        self,
        keys: Sequence[tuple[int, int, int]],
        slots: npt.ArrayLike,
        parents: npt.ArrayLike,
        store: VertexStore,
    ) -> npt.NDArray[np.void]:
        """Write tiles; return their lowest and highest height and error."""


@runtime_checkable
class BoundedTerrain(Protocol):
    """Terrain of finite extent and resolution."""

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north (m) of the drawn region."""

    @property
    def finest_cell(self) -> float:
        """Least vertex spacing of tiles (m)."""


@runtime_checkable
class PaintedTerrain(Protocol):
    """Terrain that vectors may paint on."""

    @property
    def appearance(self) -> Appearance | None:
        """What they paint."""


class TerrainSource(TileSource, Protocol):
    """Terrain that a renderer draws; see `sketchterrain.terrain.Terrain`."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the sketch (m)."""

    @property
    def features(self) -> TerrainFeatures:
        """Placed features."""

    @property
    def sea_level(self) -> float | None:
        """Level of the sea (m); None without one."""

    def heights(
        self, x: npt.ArrayLike, y: npt.ArrayLike, *, cell_size: float = 0.0
    ) -> npt.NDArray[np.float32]:
        """Return heights (m) at positions (m), band-limited to a cell size (m)."""

    def foliage(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.void]:
        """Return plants in a rectangle (m): x, y, z, species, scale, rotation."""

    def foliage_steps(
        self, west: float, south: float, east: float, north: float
    ) -> Generator[None, None, npt.NDArray[np.void]]:
        """Yield between steps of a few ms; return the plants."""


def visible_rectangle(terrain: TerrainSource) -> tuple[float, float, float, float]:
    """Return west, south, east, north (m) of the sketch, or of the bounds of a `BoundedTerrain`."""
    return terrain.bounds if isinstance(terrain, BoundedTerrain) else (0.0, 0.0, *terrain.size)


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights (n, n; m), row 0 south, at the texel centres of a square of `width` m."""

    west: float
    south: float
    width: float
    heights: npt.NDArray[np.float32]

    @property
    def texel(self) -> float:
        """Width of a texel (m)."""
        return self.width / len(self.heights)

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Float64Array:
        """Return bilinear heights (m), clamped to the border."""
        n = len(self.heights)
        col = np.clip((np.asarray(x, np.float64) - self.west) / self.texel - 0.5, 0.0, n - 1.001)
        row = np.clip((np.asarray(y, np.float64) - self.south) / self.texel - 0.5, 0.0, n - 1.001)
        i, j = col.astype(np.intp), row.astype(np.intp)
        u, v = col - i, row - j
        h = self.heights
        south = h[j, i] * (1 - u) + h[j, i + 1] * u
        north = h[j + 1, i] * (1 - u) + h[j + 1, i + 1] * u
        return np.asarray(south * (1 - v) + north * v)

    def rasterized_mask(
        self, positions: Sequence[npt.NDArray[Any]], widths: Sequence[npt.NDArray[Any]]
    ) -> HeightMap:
        """Return a mask of the same square: 1 in squares of `widths` (m) around `positions` (m), 0 elsewhere.

        Squares narrower than a texel have their share of it as value, at least 1/3.
        """
        n = len(self.heights)
        marks = np.zeros((n, n), np.float32)
        for place, width in zip(positions, widths, strict=True):
            cell = np.floor((place[:, :2] - [self.west, self.south]) / self.texel).astype(np.intp)
            radius = (width / self.texel / 2).astype(np.intp)
            value = np.clip(width / self.texel, 1 / 3, 1.0).astype(np.float32)
            is_single = (radius == 0) & ((cell >= 0) & (cell < n)).all(axis=1)
            np.maximum.at(marks, tuple(cell[is_single, ::-1].T), value[is_single])
            rest = (each[~is_single].tolist() for each in (cell, radius, value))
            for (i, j), r, v in zip(*rest, strict=True):
                window = marks[max(j - r, 0) : max(j + r + 1, 0), max(i - r, 0) : max(i + r + 1, 0)]
                np.maximum(window, v, out=window)
        return HeightMap(self.west, self.south, self.width, marks)


def surface_heights(
    terrain: TerrainSource, x: npt.ArrayLike, y: npt.ArrayLike, *, cell_size: float = 0.0
) -> npt.NDArray[np.float32]:
    """Return heights (m) as `TerrainSource.heights` does, with the sea's surface above its bed."""
    heights, level = terrain.heights(x, y, cell_size=cell_size), terrain.sea_level
    return heights if level is None else np.maximum(heights, np.float32(level))


def sample_heights(
    terrain: TerrainSource, centre: tuple[float, float], width: float, texels: int, *, cell: float = 1.0
) -> HeightMap:
    """Return heights of a square of a terrain, with the sea's surface, band-limited to a cell (texels)."""
    west, south = centre[0] - width / 2, centre[1] - width / 2
    along = (np.arange(texels) + 0.5) * (width / texels)
    x, y = west + along[None, :], south + along[:, None]
    heights = surface_heights(terrain, x, y, cell_size=cell * width / texels)
    return HeightMap(west, south, width, np.ascontiguousarray(heights, dtype=np.float32))
