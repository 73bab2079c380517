"""A terrain at the vertices of a grid, as small as files hold it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from sketchterrain.export.grid import Grid

__all__ = ["Sampled"]


@dataclass(frozen=True, eq=False)
class Sampled:
    """What is known at each vertex of a grid; row 0 is the north edge, column 0 the west one.

    Attributes
    ----------
    grid : Grid
    height : (rows, columns) float32
        m.
    normal : (rows, columns, 3) uint8
        East, north, up; 0 is −1, 255 is 1.
    weights : (rows, columns, materials) uint8
        Of the materials, in the terrain's order; they sum to 255 at each vertex.
    """

    grid: Grid
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.uint8]
    weights: npt.NDArray[np.uint8]

    def part(self, left: int, top: int, columns: int, rows: int) -> Sampled:
        """Return some of its vertices, from a column and a row on: views, no copies."""
        at = slice(top, top + rows), slice(left, left + columns)
        return Sampled(
            self.grid.part(left, top, columns, rows), self.height[at], self.normal[at], self.weights[at]
        )
