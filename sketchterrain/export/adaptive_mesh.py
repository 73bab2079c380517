"""A mesh with as few triangles as an error allows: greedy insertion, then checked by another's arithmetic.

Garland & Heckbert 1995, "Fast Polygonal Approximation of Terrains and Height Fields": the vertex that is
furthest off is put into a Delaunay triangulation until none is off by more than the bound. pydelatin does it
in float32, so its own idea of the error is not taken for granted: `mesh_error` measures it in float64.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.export.mesh import Mesh, grid_mesh
from sketchterrain.export.mesh_error import mesh_error

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Adapted", "adaptive_mesh"]

_ROUNDING = 4.0 * float(np.finfo(np.float32).eps)  # of a height that is weighed from three others


class Adapted(NamedTuple):
    """A mesh, and how far it is off at most, measured, m."""

    mesh: Mesh
    error: float


def adaptive_mesh(height: npt.NDArray[np.float32], error: float) -> Adapted:
    """Return a mesh that is nowhere further off than asked, at any vertex of the grid.

    Parameters
    ----------
    height
        (rows, columns), m.
    error
        m, vertical.

    Returns
    -------
    Adapted
        The same one for the same heights.

    Raises
    ------
    InputError
        If the error is no number above 0.
    """
    from pydelatin import Delatin

    if not (0.0 < error < np.inf):
        raise InputError(f"expected an error of a mesh above 0 m, got {error:g}")
    rows, columns = height.shape
    heights = np.ascontiguousarray(height, np.float32)
    aim = error - _ROUNDING * float(np.abs(heights).max())
    while aim > 0.0:
        made = Delatin(heights, max_error=aim)
        # Its rows count from the south, so its triangles are counter-clockwise from above.
        places = made.vertices[:, :2].astype(np.int32)
        mesh = Mesh(places[:, 0], (rows - 1) - places[:, 1], made.triangles)
        off = mesh_error(mesh, height)
        if off <= error:
            return Adapted(mesh, off)
        aim -= 2.0 * min(off - error, aim)
    return Adapted(grid_mesh(columns, rows), 0.0)
