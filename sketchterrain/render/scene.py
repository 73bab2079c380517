"""What a renderer needs of a terrain, and nothing more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    import numpy.typing as npt

__all__ = ["Features", "Reach", "Sketch", "Surface", "Terrain"]


class Surface(Protocol):
    """A tile: heights (m), unit normals and material weights at its vertices, row 0 north."""

    @property
    def height(self) -> npt.NDArray[np.float32]: ...
    @property
    def normal(self) -> npt.NDArray[np.float32]: ...
    @property
    def materials(self) -> npt.NDArray[np.float32]: ...


class Reach(Protocol):
    """A river's centreline: x, y and water surface z (m), springs first, and its width (m)."""

    @property
    def centreline(self) -> npt.NDArray[np.float64]: ...
    @property
    def centreline_width(self) -> npt.NDArray[np.float32]: ...


class Features(Protocol):
    """Placed features."""

    @property
    def points(self) -> npt.NDArray[np.void]: ...
    @property
    def rivers(self) -> Sequence[Reach]: ...


class Sketch(Protocol):
    """The document that the terrain was built from."""

    @property
    def climate(self) -> Mapping[str, float]: ...


class Terrain(Protocol):
    """An endless terrain, see `sketchterrain.terrain`."""

    @property
    def extent(self) -> float: ...
    @property
    def size(self) -> tuple[float, float]: ...
    @property
    def sketch(self) -> Sketch: ...
    @property
    def features(self) -> Features: ...

    def heights(
        self, x: npt.ArrayLike, y: npt.ArrayLike, *, cell_size: float = 0.0
    ) -> npt.NDArray[np.float32]: ...

    def tiles(self, keys: Sequence[tuple[int, int, int]]) -> Sequence[Surface]: ...

    def foliage(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.void]: ...
