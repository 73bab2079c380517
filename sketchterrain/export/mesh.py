"""Terrain as triangles: all vertices of a grid, or an adaptive mesh with a measured error bound.

Garland & Heckbert 1995, "Fast Polygonal Approximation of Terrains and Height Fields": the vertex with the
largest error is inserted into a Delaunay triangulation until no error exceeds the bound. pydelatin works in
float32, so the error is measured again in float64 at all vertices of the grid; triangles are clipped by rows
in integers, so none on an edge is missed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.errors import InputError
from sketchterrain.export.target import Export, ExportOptions

MIN_ERROR: Final = 0.001  # m; about the precision of float32 for heights of kilometres

_ROUNDING = 4.0 * float(np.finfo(np.float32).eps)  # of a height interpolated from three others
_TRIANGLES = 1 << 18
_SAMPLES = 1 << 21  # at once: bounds the memory to a few hundred megabytes


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
    worst = 0.0
    for first in range(0, len(mesh.triangles), _TRIANGLES):
        index = mesh.triangles[first : first + _TRIANGLES]
        x = mesh.column[index].astype(np.int64)
        y = mesh.row[index].astype(np.int64)
        origin, slope_x, slope_y = _planes(x, y, corners[index])
        for spans in _pieces(_spans(x, y)):
            of, row = np.repeat(spans.triangle, spans.count), np.repeat(spans.row, spans.count)
            column = _ranges(spans.first, spans.count)
            surface = origin[of] + slope_x[of] * (column - x[of, 0]) + slope_y[of] * (row - y[of, 0])
            worst = max(worst, float(np.abs(surface - height[row, column]).max(initial=0.0)))
            missed[row, column] = False
    return float("inf") if missed.any() else worst


class _Spans(NamedTuple):
    """Runs of grid vertices within triangles, each in one row."""

    triangle: Int64Array
    row: Int64Array
    first: Int64Array  # column
    count: Int64Array

    def select(self, which: slice | npt.NDArray[np.bool_]) -> _Spans:
        return _Spans(*(part[which] for part in self))


def _planes(x: Int64Array, y: Int64Array, z: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return each triangle's height at its first corner, and its slopes along columns and rows."""
    (ux, vx), (uy, vy), (uz, vz) = ((part[:, 1:] - part[:, :1]).T for part in (x, y, z))
    area = ux * vy - uy * vx
    flat = area == 0  # a degenerate triangle: its corners are in its neighbours too
    divisor = np.where(flat, 1, area).astype(np.float64)
    slope_x, slope_y = (uz * vy - uy * vz) / divisor, (ux * vz - uz * vx) / divisor
    return z[:, 0], np.where(flat, 0.0, slope_x), np.where(flat, 0.0, slope_y)


def _spans(x: Int64Array, y: Int64Array) -> _Spans:
    """Return the grid vertices in each non-degenerate triangle, its edges included."""
    order = np.argsort(y, axis=1, kind="stable")
    x0, x1, x2 = np.take_along_axis(x, order, axis=1).T
    y0, y1, y2 = np.take_along_axis(y, order, axis=1).T
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    rows = np.where(area == 0, 0, y2 - y0 + 1)
    of = np.repeat(np.arange(len(x)), rows)
    row = _ranges(y0, rows)
    # The longest edge is crossed in every row, one of the two others besides.
    upper = (row < y1[of]) | (y1 == y2)[of]
    ends = [
        (x0[of], y0[of], x2[of], y2[of]),
        tuple(np.where(upper, a[of], b[of]) for a, b in ((x0, x1), (y0, y1), (x1, x2), (y1, y2))),
    ]
    low, high = [], []
    for from_x, from_y, to_x, to_y in ends:
        down, along = to_y - from_y, (row - from_y) * (to_x - from_x)
        low.append(from_x - (-along // down))
        high.append(from_x + along // down)
    first = np.minimum(*low)
    return _Spans(of, row, first, np.maximum(np.maximum(*high) - first + 1, 0))


def _pieces(spans: _Spans) -> Iterator[_Spans]:
    """Yield non-empty spans in batches of a bounded number of vertices."""
    spans = spans.select(spans.count > 0)
    upto = np.cumsum(spans.count)
    start = 0
    while start < len(upto):
        before = int(upto[start - 1]) if start else 0
        stop = max(int(np.searchsorted(upto, before + _SAMPLES, side="right")), start + 1)
        yield spans.select(slice(start, stop))
        start = stop


def _ranges(first: Int64Array, count: Int64Array) -> Int64Array:
    """Return the concatenated ranges first … first + count − 1."""
    before = np.cumsum(count) - count
    return np.asarray(np.arange(int(count.sum())) - np.repeat(before - first, count))
