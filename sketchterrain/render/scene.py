"""What the renderer draws: the scene and its relief."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from sketchterrain.look.water_surfaces import PlacedFeatures
from sketchterrain.tiles.stream import QUADS

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.vertices import VertexMemory, VertexStore


class Sketch(Protocol):
    """The document that the terrain was built from."""

    @property
    def climate(self) -> Mapping[str, float]:
        """Climate parameters by name."""
        ...

    @property
    def look(self) -> Mapping[str, Mapping[str, Any]]:
        """What materials look like, by material, as far as the sketch says."""
        ...

    @property
    def weather(self) -> Mapping[str, float]:
        """Weather parameters by name."""
        ...


class TileSource(Protocol):
    """A terrain that writes tiles where they are drawn from; see `sketchterrain.terrain.TerrainSource`."""

    @property
    def extent(self) -> float:
        """Width of a level-0 tile (m)."""
        ...

    @property
    def context(self) -> ComputeContext:
        """What computes it."""
        ...

    def vertex_store(
        self, slots: int, *, quads: int = QUADS, memory: VertexMemory | None = None
    ) -> VertexStore:
        """Room for so many tiles."""
        ...

    def write_tiles(
        self,
        keys: Sequence[tuple[int, int, int]],
        slots: npt.ArrayLike,
        parents: npt.ArrayLike,
        store: VertexStore,
    ) -> npt.NDArray[np.void]:
        """Write tiles, and tell their lowest and highest height and their error."""
        ...


@runtime_checkable
class BoundedTerrain(Protocol):
    """What a ground tells besides if it ends, and is not known as finely as one likes."""

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north (m): nothing is drawn beyond them."""
        ...

    @property
    def finest_cell(self) -> float:
        """Metres between its vertices: no tile is finer."""
        ...


class TerrainSource(TileSource, Protocol):
    """An endless terrain, see `sketchterrain.terrain`."""

    @property
    def size(self) -> tuple[float, float]:
        """East and north size of the sketch (m)."""
        ...

    @property
    def sketch(self) -> Sketch:
        """The document."""
        ...

    @property
    def features(self) -> PlacedFeatures:
        """What the terrain is evaluated from."""
        ...

    def heights(
        self, x: npt.ArrayLike, y: npt.ArrayLike, *, cell_size: float = 0.0
    ) -> npt.NDArray[np.float32]:
        """Heights (m) at places (m), band-limited to a cell size (m)."""
        ...

    def foliage(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.void]:
        """Plants in a rectangle (m): x, y, z, species, scale, rotation."""
        ...

    def foliage_steps(
        self, west: float, south: float, east: float, north: float
    ) -> Generator[None, None, npt.NDArray[np.void]]:
        """Find them in steps of a few ms."""
        ...


def visible_rectangle(terrain: TerrainSource) -> tuple[float, float, float, float]:
    """Return west, south, east, north (m) of what there is to see: the sketch, or a ground that ends."""
    return terrain.bounds if isinstance(terrain, BoundedTerrain) else (0.0, 0.0, *terrain.size)


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights on a square grid of texel centres."""

    west: float
    south: float
    width: float
    heights: npt.NDArray[np.float32]

    @property
    def texel(self) -> float:
        """Width of a texel (m)."""
        return self.width / len(self.heights)

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Float64Array:
        """Interpolate heights (m); places outside take the border's."""
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
        self, places: Sequence[npt.NDArray[Any]], widths: Sequence[npt.NDArray[Any]]
    ) -> HeightMap:
        """Make a map of the same square that is 1 around the given places and 0 elsewhere."""
        n = len(self.heights)
        marks = np.zeros((n, n), np.float32)
        for place, width in zip(places, widths, strict=True):
            cell = np.floor((place[:, :2] - [self.west, self.south]) / self.texel).astype(np.intp)
            reach = (width / self.texel / 2).astype(np.intp)
            value = np.clip(width / self.texel, 1 / 3, 1.0)
            for (i, j), r, v in zip(cell.tolist(), reach.tolist(), value.tolist(), strict=True):
                window = marks[max(j - r, 0) : max(j + r + 1, 0), max(i - r, 0) : max(i + r + 1, 0)]
                np.maximum(window, v, out=window)
        return HeightMap(self.west, self.south, self.width, marks)


def sample_heights(
    terrain: TerrainSource, centre: tuple[float, float], width: float, texels: int
) -> HeightMap:
    """Sample a square of a terrain, band-limited to what the texels can carry."""
    west, south = centre[0] - width / 2, centre[1] - width / 2
    along = (np.arange(texels) + 0.5) * (width / texels)
    heights = terrain.heights(west + along[None, :], south + along[:, None], cell_size=width / texels)
    return HeightMap(west, south, width, np.ascontiguousarray(heights, dtype=np.float32))
