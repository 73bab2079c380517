"""The ground of an export as a mesh: all of its grid's vertices, or as few as an error allows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.export.adaptive_mesh import FINEST, Adapted, adaptive_mesh
from sketchterrain.export.mesh import grid_mesh

if TYPE_CHECKING:
    from sketchterrain.export.target import Export, ExportOptions

__all__ = ["check_error", "ground_mesh", "mesh_facts"]


def check_error(options: ExportOptions) -> None:
    """Refuse an error that no mesh can be asked for.

    Raises
    ------
    InputError
        If it is no number from `FINEST` on.
    """
    if options.error is not None and not (FINEST <= options.error < np.inf):
        raise InputError(f"expected an error of a mesh from {FINEST:g} m on, got {options.error:g}")


def ground_mesh(export: Export) -> Adapted:
    """Return the mesh that an export's options ask for, and how far it is off."""
    with export.stages.stage("mesh", "Triangles"):
        if export.options.error is None:
            return Adapted(grid_mesh(export.grid.columns, export.grid.rows), 0.0)
        return adaptive_mesh(export.sampled.height, export.options.error)


def mesh_facts(export: Export, made: Adapted) -> dict[str, Any]:
    """Return what the sidecar says of a mesh; errors are vertical, at the grid's vertices."""
    asked = {} if export.options.error is None else {"error_asked": export.options.error}
    return {
        "vertices": len(made.mesh.column),
        "triangles": len(made.mesh.triangles),
        **asked,
        "error_measured": made.error,
        "error_is": "m, the largest vertical distance at any vertex of the grid",
    }
