"""The ground of an export as a mesh: all of its grid's vertices, or as few as an error allows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.export.adaptive_mesh import Adapted, adaptive_mesh
from sketchterrain.export.mesh import grid_mesh
from sketchterrain.export.mesh_error import mesh_error

if TYPE_CHECKING:
    from sketchterrain.export.target import Export, ExportOptions

__all__ = ["FINEST", "check_error", "ground_mesh", "mesh_facts"]

FINEST: Final = 0.001
"""m: the smallest error that can be asked for; float32 holds heights of kilometres about as finely."""


def check_error(options: ExportOptions) -> None:
    """Check the error bound of a mesh.

    Raises
    ------
    InputError
        If it is no number from `FINEST` on.
    """
    if options.error is None:
        return
    if not (FINEST <= options.error < np.inf):
        raise InputError(f"expected an error of a mesh from {FINEST:g} m on, got {options.error:g}")


def ground_mesh(export: Export, *, decimals: int | None = None) -> Adapted:
    """Return the mesh that an export's options ask for, and how far it is off as it is written.

    Parameters
    ----------
    export
    decimals
        Of a metre that the file's heights have; None: they are float32, as they come.
    """
    height, error = export.sampled.height, export.options.error
    with export.stages.stage("mesh", "Triangles"):
        lost = 0.0 if decimals is None else 0.5 * 10.0**-decimals
        if error is None:
            made = Adapted(grid_mesh(export.grid.columns, export.grid.rows), 0.0)
        else:
            made = adaptive_mesh(height, error - lost)
        if decimals is None:
            return made
        written = np.round(made.mesh.of(height).astype(np.float64), decimals)
        return Adapted(made.mesh, mesh_error(made.mesh, height, written))


def mesh_facts(export: Export, made: Adapted) -> dict[str, Any]:
    """Return what the sidecar says of a mesh."""
    asked = {} if export.options.error is None else {"error_asked": export.options.error}
    return {
        "vertices": len(made.mesh.column),
        "triangles": len(made.mesh.triangles),
        **asked,
        "error_measured": made.error,
        "error_is": "m, the largest vertical distance at any vertex of the grid",
    }
