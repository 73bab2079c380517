"""The ground as triangles: of all vertices of a grid, or as few as an error allows, which is measured.

Garland & Heckbert 1995, "Fast Polygonal Approximation of Terrains and Height Fields": the vertex that is
furthest off is put into a Delaunay triangulation until none is off by more than the bound. pydelatin does it
in float32, so the error of its mesh is measured again in float64: which vertices lie in a triangle is found
in whole numbers, row by row, so none on an edge is missed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.export.target import Export, ExportOptions

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
FINEST: Final = 0.001
"""m: the smallest error that can be asked for; float32 holds heights of kilometres about as finely."""

_ROUNDING = 4.0 * float(np.finfo(np.float32).eps)  # of a height that is weighed from three others
_TRIANGLES = 1 << 18
_SAMPLES = 1 << 21  # at once: bounds the memory to a few hundred megabytes


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


def check_error(options: ExportOptions) -> None:
    """Check the error bound of a mesh."""
    if options.error is None:
        return
    if not (FINEST <= options.error < np.inf):
        raise InputError(f"expected an error of a mesh from {FINEST:g} m on, got {options.error:g}")


def ground_mesh(export: Export, *, decimals: int | None = None) -> Adapted:
    """Return the mesh that an export's options ask for, and how far it is off as it is written."""
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


class Adapted(NamedTuple):
    """A mesh, and how far it is off at most, measured, m."""

    mesh: Mesh
    error: float


def adaptive_mesh(height: npt.NDArray[np.float32], error: float) -> Adapted:
    """Return a mesh that is nowhere further off than asked, at any vertex of the grid."""
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


def mesh_error(
    mesh: Mesh, height: npt.NDArray[np.floating], written: npt.NDArray[np.floating] | None = None
) -> float:
    """Return the largest vertical distance between a mesh and the grid that it stands for.

    Parameters
    ----------
    mesh
    height
        (rows, columns), m.
    written
        (n,) m: heights of the mesh's vertices as a file holds them; the grid's by default.

    Returns
    -------
    float
        m, over all vertices of the grid; infinite if the mesh leaves one of them uncovered.
    """
    corners = mesh.of(height) if written is None else written
    corners = corners.astype(np.float64)
    missed = np.ones(height.shape, bool)
    worst = 0.0
    for first in range(0, len(mesh.triangles), _TRIANGLES):
        index = mesh.triangles[first : first + _TRIANGLES]
        x = mesh.column[index].astype(np.int64)
        y = mesh.row[index].astype(np.int64)
        origin, slope_x, slope_y = _planes(x, y, corners[index])
        for spans in _pieces(_spans(x, y)):
            of, row = np.repeat(spans.triangle, spans.many), np.repeat(spans.row, spans.many)
            column = _counted(spans.first, spans.many)
            surface = origin[of] + slope_x[of] * (column - x[of, 0]) + slope_y[of] * (row - y[of, 0])
            worst = max(worst, float(np.abs(surface - height[row, column]).max(initial=0.0)))
            missed[row, column] = False
    return float("inf") if missed.any() else worst


class _Spans(NamedTuple):
    """Vertices of one row in one triangle: from a first column on, so many."""

    triangle: Ints
    row: Ints
    first: Ints
    many: Ints

    def some(self, which: slice | npt.NDArray[np.bool_]) -> _Spans:
        return _Spans(*(part[which] for part in self))


def _planes(x: Ints, y: Ints, z: Floats) -> tuple[Floats, Floats, Floats]:
    """Return each triangle's height at its first corner, and its slopes along columns and rows."""
    (ux, vx), (uy, vy), (uz, vz) = ((part[:, 1:] - part[:, :1]).T for part in (x, y, z))
    area = ux * vy - uy * vx
    flat = area == 0  # such a triangle is a line: its corners are in its neighbours too
    whole = np.where(flat, 1, area).astype(np.float64)
    slope_x, slope_y = (uz * vy - uy * vz) / whole, (ux * vz - uz * vx) / whole
    return z[:, 0], np.where(flat, 0.0, slope_x), np.where(flat, 0.0, slope_y)


def _spans(x: Ints, y: Ints) -> _Spans:
    """Return the vertices of the grid in each triangle that is no line, its edges included."""
    order = np.argsort(y, axis=1, kind="stable")
    x0, x1, x2 = np.take_along_axis(x, order, axis=1).T
    y0, y1, y2 = np.take_along_axis(y, order, axis=1).T
    area = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    rows = np.where(area == 0, 0, y2 - y0 + 1)
    of = np.repeat(np.arange(len(x)), rows)
    row = _counted(y0, rows)
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
    """Yield spans in pieces of a bounded number of vertices; none of them is empty."""
    spans = spans.some(spans.many > 0)
    upto = np.cumsum(spans.many)
    start = 0
    while start < len(upto):
        before = int(upto[start - 1]) if start else 0
        stop = max(int(np.searchsorted(upto, before + _SAMPLES, side="right")), start + 1)
        yield spans.some(slice(start, stop))
        start = stop


def _counted(first: Ints, count: Ints) -> Ints:
    """Return first, first + 1 … of each entry, as many as its count."""
    before = np.cumsum(count) - count
    return np.asarray(np.arange(int(count.sum())) - np.repeat(before - first, count))
