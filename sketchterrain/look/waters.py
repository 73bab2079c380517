"""Interfaces of the placed features that water surfaces are built from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt


class RiverGeometry(Protocol):
    """A river, from its source downstream."""

    @property
    def centreline(self) -> npt.NDArray[np.float64]:
        """(m, 3) x, y and water surface z (m)."""

    @property
    def centreline_width(self) -> npt.NDArray[np.float32]:
        """(m,) width (m)."""


class DistanceRaster(Protocol):
    """A raster of the distance inside a shape's border, rows northward."""

    @property
    def west(self) -> float:
        """Position of the first sample (m)."""

    @property
    def south(self) -> float:
        """Position of the first sample (m)."""

    @property
    def spacing(self) -> float:
        """Distance between samples (m)."""

    @property
    def inside(self) -> npt.NDArray[np.float32]:
        """(rows, columns) m, negative outside."""


class LakeGeometry(Protocol):
    """A lake."""

    @property
    def shape(self) -> DistanceRaster:
        """Its area."""

    @property
    def level(self) -> float:
        """Elevation of the water (m)."""


class PlacedFeatures(Protocol):
    """Placed features."""

    @property
    def points(self) -> npt.NDArray[np.void]:
        """Placed point features."""

    @property
    def rivers(self) -> Sequence[RiverGeometry]:
        """Placed rivers."""

    @property
    def lakes(self) -> Sequence[LakeGeometry]:
        """Placed lakes."""
