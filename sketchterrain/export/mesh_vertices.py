"""Vertices along a program's axes: of ground meshes with normals and texture coordinates, and of waters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.mesh import Mesh
from sketchterrain.export.sampled import Grid, Sampled

if TYPE_CHECKING:  # loads OpenCL
    from sketchterrain.terrain import TerrainFeatures

Singles = npt.NDArray[np.float32]
LARGEST_TEXTURE = 8192
"""Texels a side that graphics cards of today take."""

_AT_ONCE = 1 << 20  # vertices: bounds the memory
_SHOWN = 0.5  # of a river, less is the lake's or the wider river's that it runs into
_DIVE = 0.3  # m that it goes below them there: two surfaces in one plane flicker


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
        fall = height[north, column].astype(np.float64) - height[south, column]
        slope_north = fall / ((south - north) * dy)
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


class Water(NamedTuple):
    """One river or lake."""

    name: str  # "river 7", by its id
    place: npt.NDArray[np.float64]  # (n, 3): x east, y north, z up, m
    triangles: npt.NDArray[np.uint32]  # (k, 3), counter-clockwise from above


def waters(features: TerrainFeatures, grid: Grid) -> Iterator[Water]:
    """Return each water as far as it lies in a grid's rectangle, lakes first."""
    from sketchterrain.look.water_surfaces import water_surfaces  # SciPy: not for a list of targets

    rivers = [river for river in features.rivers if len(river.centreline) > 1]
    names = [f"lake {lake.id}" for lake in features.lakes] + [f"river {river.id}" for river in rivers]
    for name, surface in zip(names, water_surfaces(features), strict=True):
        triangles = surface.triangles.reshape(-1, 3)
        x, y = surface.position[:, 0], surface.position[:, 1]
        inside = (x >= grid.west) & (x <= grid.east) & (y >= grid.south) & (y <= grid.north)
        shown = surface.stream[triangles, 2].mean(axis=1) >= _SHOWN
        place = surface.position.copy()
        # What reaches over the edge ends there.
        np.clip(place[:, :2], (grid.west, grid.south), (grid.east, grid.north), out=place[:, :2])
        place[:, 2] -= _DIVE * (1.0 - surface.stream[:, 2])
        kept = triangles[shown & inside[triangles].any(axis=1) & _has_area(place, triangles)]
        if len(kept):
            used, index = np.unique(kept, return_inverse=True)
            yield Water(name, place[used], index.reshape(-1, 3).astype(np.uint32))


def _has_area(place: npt.NDArray[np.float64], triangles: npt.NDArray[np.uint32]) -> npt.NDArray[np.bool_]:
    (ax, ay), (bx, by), (cx, cy) = (place[triangles[:, k], :2].T for k in range(3))
    return np.asarray((bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0.0)
