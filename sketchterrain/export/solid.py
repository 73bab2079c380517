"""A mesh of the ground made solid: walls down to a flat base, so that it can be printed."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.mesh import Mesh

__all__ = ["Solid", "border", "solid"]


class Solid(NamedTuple):
    """Triangles that enclose a body, counter-clockwise from outside.

    Attributes
    ----------
    place : (n, 3) float32
        x east, y north, z up.
    triangles : (k, 3) uint32
    """

    place: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.uint32]


def border(mesh: Mesh) -> npt.NDArray[np.int64]:
    """Return the vertices on the edges of a mesh's rectangle, counter-clockwise from the south-west."""
    last_column, last_row = int(mesh.column.max()), int(mesh.row.max())
    sides = (
        (mesh.row == last_row, mesh.column),
        (mesh.column == last_column, -mesh.row),
        (mesh.row == 0, -mesh.column),
        (mesh.column == 0, mesh.row),
    )
    ring = []
    for on_side, along in sides:
        index = np.flatnonzero(on_side)
        ring.append(index[np.argsort(along[index], kind="stable")][:-1])  # its end begins the next side
    return np.concatenate(ring)


def solid(mesh: Mesh, place: npt.NDArray[np.float32], base: float) -> Solid:
    """Return a mesh with walls and a floor: every edge belongs to two triangles, once each way.

    Parameters
    ----------
    mesh
    place
        (n, 3) of its vertices: x east, y north, z up.
    base
        z of the floor, below all of them.
    """
    top = border(mesh)
    following = np.roll(top, -1)
    count = len(place)
    below = count + np.arange(len(top))
    below_following = np.roll(below, -1)
    middle = np.full(len(top), count + len(top))
    floor = place[top].copy()
    floor[:, 2] = base
    low, high = place.min(axis=0), place.max(axis=0)
    centre = np.array([[0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), base]], np.float32)
    walls = [
        np.stack([below, below_following, following], axis=-1),
        np.stack([below, following, top], axis=-1),
        np.stack([middle, below_following, below], axis=-1),
    ]
    triangles = np.concatenate([mesh.triangles, *(wall.astype(np.uint32) for wall in walls)])
    return Solid(np.concatenate([place, floor, centre]), triangles)
