"""A mesh's vertices along a program's axes: places, normals of the ground, places in its texture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.export.engine_axes import EngineAxes
    from sketchterrain.export.grid import Grid
    from sketchterrain.export.mesh import Mesh
    from sketchterrain.export.sampled import Sampled

    Singles = npt.NDArray[np.float32]

__all__ = ["LARGEST_TEXTURE", "mesh_normals", "mesh_places", "mesh_texels", "texel_step"]

LARGEST_TEXTURE = 8192
"""Texels a side that graphics cards of today take."""

_AT_ONCE = 1 << 20  # vertices: bounds the memory


def mesh_places(mesh: Mesh, sampled: Sampled, axes: EngineAxes) -> Singles:
    """Return where a mesh's vertices are: (n, 3), in the axes' unit."""
    grid = sampled.grid
    dx, dy = grid.spacing
    result = np.empty((len(mesh.column), 3), np.float32)
    for some in _parts(mesh):
        column, row = mesh.column[some], mesh.row[some]
        height = sampled.height[row, column]
        result[some] = axes.places(grid.west + column * dx, grid.north - row * dy, height)
    return result


def mesh_normals(mesh: Mesh, sampled: Sampled, axes: EngineAxes) -> Singles:
    """Return unit normals of the ground, (n, 3), from the heights of each vertex' neighbours in the grid.

    They are those of the grid at any error of the mesh, and finer than the bytes of a normal map.
    """
    dx, dy = sampled.grid.spacing
    height = sampled.height
    result = np.empty((len(mesh.column), 3), np.float32)
    for some in _parts(mesh):
        column, row = mesh.column[some].astype(np.intp), mesh.row[some].astype(np.intp)
        west, east = np.maximum(column - 1, 0), np.minimum(column + 1, sampled.grid.columns - 1)
        north, south = np.maximum(row - 1, 0), np.minimum(row + 1, sampled.grid.rows - 1)
        slope_east = (height[row, east].astype(np.float64) - height[row, west]) / ((east - west) * dx)
        slope_north = (height[north, column].astype(np.float64) - height[south, column]) / (
            (south - north) * dy
        )
        normal = np.stack([-slope_east, -slope_north, np.ones(len(column))], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        result[some] = axes.directions(normal)
    return result


def texel_step(grid: Grid) -> int:
    """Return every how many-th vertex has a texel, so that a texture is no larger than `LARGEST_TEXTURE`."""
    return -(-max(grid.columns, grid.rows) // LARGEST_TEXTURE)


def mesh_texels(mesh: Mesh, grid: Grid) -> Singles:
    """Return texture coordinates, (n, 2), 0 … 1 from the west and from the north.

    A vertex that has a texel lies in its middle.
    """
    step = texel_step(grid)
    texels = -(-grid.columns // step), -(-grid.rows // step)
    result = np.empty((len(mesh.column), 2), np.float32)
    for axis, place in enumerate((mesh.column, mesh.row)):
        result[:, axis] = np.minimum((place / step + 0.5) / texels[axis], 1.0)
    return result


def _parts(mesh: Mesh) -> Iterator[slice]:
    for first in range(0, len(mesh.column), _AT_ONCE):
        yield slice(first, first + _AT_ONCE)
