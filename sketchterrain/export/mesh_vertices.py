"""Vertex positions, normals and texture coordinates of terrain meshes, and water meshes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array
from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.mesh import GridMesh
from sketchterrain.export.sampled import SampleGrid, TerrainSamples

if TYPE_CHECKING:  # loads OpenCL
    from sketchterrain.terrain import TerrainFeatures

MAX_TEXTURE_SIDE = 8192  # texels, of today's graphics cards

_VERTICES_AT_ONCE = 1 << 20  # bounds the memory
_MIN_RIVER_SHARE = 0.5  # of a river's triangle; with less it belongs to the lake or river it flows into
_RIVER_OFFSET = 0.3  # m that a river's end is lowered below those, against z-fighting


def mesh_positions(mesh: GridMesh, samples: TerrainSamples, axes: EngineAxes) -> Float32Array:
    """Return the positions of a mesh's vertices, (n, 3), in the axes' unit."""
    grid = samples.grid
    dx, dy = grid.spacing
    result = np.empty((len(mesh.column), 3), np.float32)
    for some in _parts(mesh):
        column, row = mesh.column[some], mesh.row[some]
        height = samples.height[row, column]
        result[some] = axes.points(grid.west + column * dx, grid.north - row * dy, height)
    return result


def mesh_normals(mesh: GridMesh, samples: TerrainSamples, axes: EngineAxes) -> Float32Array:
    """Return unit normals, (n, 3), by central differences of the full grid, whatever the mesh's error."""
    dx, dy = samples.grid.spacing
    height = samples.height
    result = np.empty((len(mesh.column), 3), np.float32)
    for some in _parts(mesh):
        column, row = mesh.column[some].astype(np.intp), mesh.row[some].astype(np.intp)
        west, east = np.maximum(column - 1, 0), np.minimum(column + 1, samples.grid.columns - 1)
        north, south = np.maximum(row - 1, 0), np.minimum(row + 1, samples.grid.rows - 1)
        slope_east = (height[row, east].astype(np.float64) - height[row, west]) / ((east - west) * dx)
        rise = height[north, column].astype(np.float64) - height[south, column]
        slope_north = rise / ((south - north) * dy)
        normal = np.stack([-slope_east, -slope_north, np.ones(len(column))], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        result[some] = axes.vectors(normal)
    return result


def texture_stride(grid: SampleGrid) -> int:
    """Return the vertices per texel along a side, so that textures are at most `MAX_TEXTURE_SIDE`."""
    return -(-max(grid.columns, grid.rows) // MAX_TEXTURE_SIDE)


def mesh_texcoords(mesh: GridMesh, grid: SampleGrid) -> Float32Array:
    """Return texture coordinates, (n, 2), 0 … 1 from the north-west; texels are centred on vertices."""
    stride = texture_stride(grid)
    texels = -(-grid.columns // stride), -(-grid.rows // stride)
    result = np.empty((len(mesh.column), 2), np.float32)
    for axis, index in enumerate((mesh.column, mesh.row)):
        result[:, axis] = np.minimum((index / stride + 0.5) / texels[axis], 1.0)
    return result


def _parts(mesh: GridMesh) -> Iterator[slice]:
    for first in range(0, len(mesh.column), _VERTICES_AT_ONCE):
        yield slice(first, first + _VERTICES_AT_ONCE)


class WaterMesh(NamedTuple):
    """Surface of one river or lake."""

    name: str  # "river 7", by its id
    position: npt.NDArray[np.float64]  # (n, 3): x east, y north, z up, m
    triangles: npt.NDArray[np.uint32]  # (k, 3), counter-clockwise from above


def water_meshes(features: TerrainFeatures, grid: SampleGrid) -> Iterator[WaterMesh]:
    """Return each water surface, clipped to a grid's rectangle, lakes first."""
    from sketchterrain.look.water_surfaces import water_surfaces  # SciPy: not for a list of targets

    rivers = [river for river in features.rivers if len(river.centreline) > 1]
    names = [f"lake {lake.id}" for lake in features.lakes] + [f"river {river.id}" for river in rivers]
    for name, surface in zip(names, water_surfaces(features), strict=True):
        triangles = surface.triangles.reshape(-1, 3)
        x, y = surface.position[:, 0], surface.position[:, 1]
        inside = (x >= grid.west) & (x <= grid.east) & (y >= grid.south) & (y <= grid.north)
        visible = surface.stream[triangles, 2].mean(axis=1) >= _MIN_RIVER_SHARE
        position = surface.position.copy()
        np.clip(position[:, :2], (grid.west, grid.south), (grid.east, grid.north), out=position[:, :2])
        position[:, 2] -= _RIVER_OFFSET * (1.0 - surface.stream[:, 2])
        (ax, ay), (bx, by), (cx, cy) = (position[triangles[:, k], :2].T for k in range(3))
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        remaining = triangles[visible & inside[triangles].any(axis=1) & (area > 0.0)]
        if len(remaining):
            used, index = np.unique(remaining, return_inverse=True)
            yield WaterMesh(name, position[used], index.reshape(-1, 3).astype(np.uint32))
