"""Terrain as triangles: all vertices of a grid, or an adaptive mesh of measured error; objects on it.

Garland & Heckbert 1995, "Fast Polygonal Approximation of Terrains and Height Fields": the vertex with the
largest error is inserted into a Delaunay triangulation until no error exceeds the bound. pydelatin works in
float32, so the error is measured again in float64 at all vertices of the grid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.sampled import SampleGrid, TerrainSamples, interpolate_heights, row_bands
from sketchterrain.export.target import Export, ExportOptions
from sketchterrain.host.library import host_function
from sketchterrain.terrain.surfaces import TerrainFeatures

if TYPE_CHECKING:
    from sketchterrain.generation.terrain import Terrain

MIN_ERROR: Final = 0.001  # m; about the precision of float32 for heights of kilometres

_ROUNDING = 4.0 * float(np.finfo(np.float32).eps)  # of a height interpolated from three others


@dataclass(frozen=True, eq=False)
class GridMesh:
    """Some of a grid's vertices, and triangles between them that cover its rectangle once."""

    column: npt.NDArray[np.int32]  # (n,) of each vertex
    row: npt.NDArray[np.int32]  # (n,); row 0 is the north edge
    triangles: npt.NDArray[np.uint32]  # (k, 3) indices of vertices, counter-clockwise from above

    def sample(self, raster: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
        """Return the values of a raster, (rows, columns, …), at the vertices: (n, …)."""
        return raster[self.row, self.column]


class MeasuredMesh(NamedTuple):
    """A mesh and its measured error (m), the largest at any vertex of the grid."""

    mesh: GridMesh
    error: float


def full_mesh(columns: int, rows: int) -> GridMesh:
    """Return the mesh of all vertices: two triangles a quad, cut from south-west to north-east."""
    row, column = np.indices((rows, columns), np.int32)
    index = np.arange(columns * rows, dtype=np.uint32).reshape(rows, columns)
    nw, ne, sw, se = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    quads = np.stack([sw, se, ne, sw, ne, nw], axis=-1)
    return GridMesh(column.ravel(), row.ravel(), quads.reshape(-1, 3))


def check_mesh_error(options: ExportOptions) -> None:
    """Raise `InputError` for an invalid error bound of a mesh."""
    if options.error is not None and not (MIN_ERROR <= options.error < np.inf):
        raise InputError(f"expected an error of a mesh from {MIN_ERROR:g} m on, got {options.error:g}")


def export_mesh(export: Export, *, decimals: int | None = None) -> MeasuredMesh:
    """Return the mesh that an export's options ask for, with its error as written, in so many decimals."""
    height, error = export.samples.height, export.options.error
    with export.stages.stage("mesh", "Triangles"):
        rounding = 0.0 if decimals is None else 0.5 * 10.0**-decimals
        if error is None:
            result = MeasuredMesh(full_mesh(export.grid.columns, export.grid.rows), 0.0)
        else:
            result = adaptive_mesh(height, error - rounding)
        if decimals is None:
            return result
        written = np.round(result.mesh.sample(height).astype(np.float64), decimals)
        return MeasuredMesh(result.mesh, mesh_error(result.mesh, height, written))


def mesh_metadata(export: Export, result: MeasuredMesh) -> dict[str, Any]:
    """Return the sidecar's entry of a mesh."""
    requested = {} if export.options.error is None else {"error_asked": export.options.error}
    return {
        "vertices": len(result.mesh.column),
        "triangles": len(result.mesh.triangles),
        **requested,
        "error_measured": result.error,
        "error_is": "m, the largest vertical distance at any vertex of the grid",
    }


def adaptive_mesh(height: npt.NDArray[np.float32], error: float) -> MeasuredMesh:
    """Return a mesh of few triangles whose error (m) is within a bound at all vertices of the grid."""
    from pydelatin import Delatin

    if not (0.0 < error < np.inf):
        raise InputError(f"expected an error of a mesh above 0 m, got {error:g}")
    rows, columns = height.shape
    heights = np.ascontiguousarray(height, np.float32)
    bound = error - _ROUNDING * float(np.abs(heights).max())
    while bound > 0.0:
        result = Delatin(heights, max_error=bound)
        # Its rows count from the south, so its triangles are counter-clockwise from above.
        places = result.vertices[:, :2].astype(np.int32)
        mesh = GridMesh(places[:, 0], (rows - 1) - places[:, 1], result.triangles)
        measured = mesh_error(mesh, height)
        if measured <= error:
            return MeasuredMesh(mesh, measured)
        bound -= 2.0 * min(measured - error, bound)
    return MeasuredMesh(full_mesh(columns, rows), 0.0)


def mesh_error(
    mesh: GridMesh, height: npt.NDArray[np.floating], written: npt.NDArray[np.floating] | None = None
) -> float:
    """Return the largest vertical distance (m) of a mesh from a grid (rows, columns), inf if it has holes.

    `written`, (n,), are the heights of its vertices as stored in a file, by default the grid's.
    """
    corners = (mesh.sample(height) if written is None else written).astype(np.float64)
    missed = np.ones(height.shape, bool)
    places = (np.ascontiguousarray(each, np.int32) for each in (mesh.column, mesh.row))
    triangles = np.ascontiguousarray(mesh.triangles, np.uint32)
    heights = np.ascontiguousarray(height, np.float64)
    largest: float = host_function("largest_distance")(triangles, *places, corners, heights, missed)
    return float("inf") if missed.any() else largest


MAX_TEXTURE_SIDE = 8192  # texels, of today's graphics cards

_VERTICES_AT_ONCE = 1 << 20  # bounds the memory
_MIN_RIVER_SHARE = 0.5  # of a river's triangle; with less it belongs to the lake or river it flows into
_RIVER_RISE = 0.1  # m of a river over the ground, at least
_RIVER_OFFSET = 0.3  # m that a river's end is lowered below those, against z-fighting


def mesh_positions(mesh: GridMesh, samples: TerrainSamples, axes: EngineAxes) -> Float32Array:
    """Return the positions of a mesh's vertices, (n, 3), in the axes' unit."""
    grid = samples.grid
    dx, dy = grid.spacing
    result = np.empty((len(mesh.column), 3), np.float32)
    for part in row_bands(len(mesh.column), _VERTICES_AT_ONCE):
        column, row = mesh.column[part], mesh.row[part]
        height = samples.height[row, column]
        result[part] = axes.points(grid.west + column * dx, grid.north - row * dy, height)
    return result


def mesh_normals(mesh: GridMesh, samples: TerrainSamples, axes: EngineAxes) -> Float32Array:
    """Return unit normals, (n, 3), by central differences of the full grid, whatever the mesh's error."""
    dx, dy = samples.grid.spacing
    height = samples.height
    result = np.empty((len(mesh.column), 3), np.float32)
    for part in row_bands(len(mesh.column), _VERTICES_AT_ONCE):
        column, row = mesh.column[part].astype(np.intp), mesh.row[part].astype(np.intp)
        west, east = np.maximum(column - 1, 0), np.minimum(column + 1, samples.grid.columns - 1)
        north, south = np.maximum(row - 1, 0), np.minimum(row + 1, samples.grid.rows - 1)
        slope_east = (height[row, east].astype(np.float64) - height[row, west]) / ((east - west) * dx)
        rise = height[north, column].astype(np.float64) - height[south, column]
        slope_north = rise / ((south - north) * dy)
        normal = np.stack([-slope_east, -slope_north, np.ones(len(column))], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        result[part] = axes.vectors(normal)
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


WATER: Final = "water"
_UP: Final = np.array([0.0, 0.0, 1.0])


class ObjectMesh(NamedTuple):
    """What one river, lake, road, bridge or building has of a material, or the sea."""

    name: str  # "river 7", "road 7 bridge", by its id
    material: str  # `WATER`, or one of the ground or of `look.built_meshes`
    position: npt.NDArray[np.float64]  # (n, 3): x east, y north, z up, m
    normal: npt.NDArray[np.float64]  # (n, 3) unit vectors
    triangles: npt.NDArray[np.uint32]  # (k, 3), counter-clockwise from above or outside


def scene_objects(export: Export) -> Iterator[ObjectMesh]:
    """Return waters, then roads and what is built."""
    yield from object_meshes(export.terrain.features, export.samples)
    yield from built_meshes(export.terrain, export.grid)


def built_meshes(terrain: Terrain, grid: SampleGrid) -> Iterator[ObjectMesh]:
    """Return roads, bridges, tunnels, buildings and walls that reach into a rectangle."""
    from sketchterrain.look.built_meshes import joined_parts
    from sketchterrain.look.road_meshes import built_objects, road_surfaces

    network, (west, south, east, north) = terrain.features.network, grid.bounds
    for each in (*road_surfaces(network), *built_objects(network, terrain.features.rivers)):
        ground = terrain.heights(*each.places.T) if len(each.places) else np.zeros(0)
        for part in joined_parts(each.parts(ground.astype(np.float64))):
            x, y, _ = part.position.T
            inside = (x >= west) & (x <= east) & (y >= south) & (y <= north)
            remaining = part.triangles[inside[part.triangles].any(axis=1)]
            yield from _object(each.name, part.material, part.position, part.normal, remaining)


def object_meshes(features: TerrainFeatures, samples: TerrainSamples) -> Iterator[ObjectMesh]:
    """Return each water surface, clipped to the samples' rectangle; the sea only over ground below it."""
    from sketchterrain.look.objects import terrain_objects  # SciPy: not for a list of targets

    grid = samples.grid
    for each in terrain_objects(features):
        if each.level is not None and not (samples.height < each.level).any():
            continue
        surface = each.mesh(grid.bounds)
        triangles = surface.triangles.reshape(-1, 3)
        x, y = surface.position[:, 0], surface.position[:, 1]
        inside = (x >= grid.west) & (x <= grid.east) & (y >= grid.south) & (y <= grid.north)
        visible = surface.stream[triangles, 2].mean(axis=1) >= _MIN_RIVER_SHARE
        position = surface.position.copy()
        np.clip(position[:, :2], (grid.west, grid.south), (grid.east, grid.north), out=position[:, :2])
        share = surface.stream[:, 2]
        if each.kind == "river":  # a channel narrower than the grid's cells is not in its heights
            ground = interpolate_heights(samples, *position[:, :2].T)
            position[:, 2] += share * np.maximum(ground + _RIVER_RISE - position[:, 2], 0.0)
        position[:, 2] -= _RIVER_OFFSET * (1.0 - share)
        (ax, ay), (bx, by), (cx, cy) = (position[triangles[:, k], :2].T for k in range(3))
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        remaining = triangles[visible & inside[triangles].any(axis=1) & (area > 0.0)]
        yield from _object(each.name, WATER, position, np.broadcast_to(_UP, position.shape), remaining)


def _object(
    name: str, material: str, position: Float64Array, normal: Float64Array, triangles: npt.NDArray[Any]
) -> Iterator[ObjectMesh]:
    """Yield an object of the vertices that some triangles have, unless there are none."""
    if len(triangles):
        used, index = np.unique(triangles, return_inverse=True)
        corners = index.reshape(-1, 3).astype(np.uint32)
        yield ObjectMesh(name, material, position[used], normal[used], corners)
