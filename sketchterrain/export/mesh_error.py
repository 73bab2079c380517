"""How far a mesh is off: its surface against the height at each vertex of the grid, in float64.

Which vertices lie in a triangle is found in whole numbers, row by row, so none on an edge is missed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.export.mesh import Mesh

    Ints = npt.NDArray[np.int64]
    Floats = npt.NDArray[np.float64]

__all__ = ["mesh_error"]

_TRIANGLES = 1 << 18
_SAMPLES = 1 << 21  # at once: bounds the memory to a few hundred megabytes


class _Spans(NamedTuple):
    """Vertices of one row in one triangle: from a first column on, so many."""

    triangle: Ints
    row: Ints
    first: Ints
    many: Ints

    def some(self, which: slice | npt.NDArray[np.bool_]) -> _Spans:
        return _Spans(*(part[which] for part in self))


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
