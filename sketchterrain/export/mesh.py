"""Triangles over the vertices of a grid, and the mesh of all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Mesh", "grid_mesh"]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Some of a grid's vertices, and triangles between them that cover its rectangle once.

    Attributes
    ----------
    column, row : (n,) int32
        Of each vertex in the grid; row 0 is the north edge.
    triangles : (k, 3) uint32
        Numbers of vertices, counter-clockwise from above.
    """

    column: npt.NDArray[np.int32]
    row: npt.NDArray[np.int32]
    triangles: npt.NDArray[np.uint32]

    def of(self, raster: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
        """Return a raster's values, (rows, columns, …), at the vertices: (n, …)."""
        return raster[self.row, self.column]


def grid_mesh(columns: int, rows: int) -> Mesh:
    """Return the mesh of all vertices: two triangles a quad, cut from its south-west to its north-east."""
    row, column = np.indices((rows, columns), np.int32)
    index = np.arange(columns * rows, dtype=np.uint32).reshape(rows, columns)
    nw, ne, sw, se = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    quads = np.stack([sw, se, ne, sw, ne, nw], axis=-1)
    return Mesh(column.ravel(), row.ravel(), quads.reshape(-1, 3))
