"""Elevation data under a sketch."""

from __future__ import annotations

from dataclasses import dataclass

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.selection import Patchwork, RimFade
from sketchterrain.elevation.surface import Heights


@dataclass(frozen=True, eq=False)
class BaseElevation:
    """Elevation data under a sketch: a value by its id."""

    patchwork: Patchwork
    fade: RimFade
    id: bytes
    findings: tuple[str, ...] = ()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, BaseElevation) and self.id == other.id

    def __hash__(self) -> int:
        return hash(self.id)

    def heights(self, x: Float64Array, y: Float64Array, cell_size: float) -> Heights:
        """Return the surface for samples of a cell size (m) at points (m) from the sketch's corner."""
        return self.patchwork.surface_for_cells(cell_size).evaluate(x, y)

    def weight(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the weight of the data: 0 along their rim, 1 inside."""
        return self.fade.weight(x, y)
