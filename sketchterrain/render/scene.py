"""What a renderer needs of a terrain, and nothing more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from sketchterrain.look.waters import PlacedFeatures
from sketchterrain.tiles import QUADS

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping, Sequence

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
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
