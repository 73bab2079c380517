"""Triangle indices of a tile for each combination of coarser neighbours (stitching without cracks).

Along a coarser tile every other border vertex collapses onto its even neighbour, and degenerate triangles are
dropped. Int64Array move so that the parent's diagonals stay edges: westward and eastward along the northern and
southern border, northward and southward along the western and eastern one. Where two such borders meet at an
end of the quads' anti-diagonal, that quad is cut the other way, to avoid a triangle without area.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Int64Array


__all__ = ["CASES", "EAST", "NORTH", "PARENT", "SOUTH", "WEST", "tile_indices"]

NORTH, SOUTH, WEST, EAST = 1, 2, 4, 8
"""Bits of a case: on that side lies a coarser tile, or one that shows nothing but its parent."""
PARENT: Final = 16
"""The case of a tile that shows nothing but its parent: every other vertex shows the same."""
CASES: Final = 17


@cache
def tile_indices(quads: int) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return (indices, first, count): the uint32 triangles of every case, and each case's part of them.

    `quads` is the even number of quads along a side. Triangles are counter-clockwise from above; vertices are
    numbered in rows from north to south, each from west to east; quads are cut from north-west to south-east.
    """
    if quads < 2 or quads % 2:
        raise InputError(f"expected an even number of quads ≥ 2, got {quads}")
    cases = [_case(quads, case) for case in range(CASES)]
    count = np.array([len(case) for case in cases], np.int64)
    indices = np.concatenate(cases).astype(np.uint32)
    for array in (indices, count, first := np.cumsum(count) - count):
        array.setflags(write=False)
    return indices, first, count


def _case(quads: int, case: int) -> Int64Array:
    side = quads + 1
    vertex = np.arange(side * side, dtype=np.int64).reshape(side, side)
    if case == PARENT:
        return _cut(vertex[::2, ::2]).reshape(-1)
    seen = vertex.copy()
    odd = np.arange(1, quads, 2)
    if case & NORTH:
        seen[0, odd] = vertex[0, odd - 1]
    if case & SOUTH:
        seen[-1, odd] = vertex[-1, odd + 1]
    if case & WEST:
        seen[odd, 0] = vertex[odd - 1, 0]
    if case & EAST:
        seen[odd, -1] = vertex[odd + 1, -1]
    nw, ne, sw, se = _corners(seen)
    triangles = _cut(seen)
    for corner, borders in (((0, -1), NORTH | EAST), ((-1, 0), SOUTH | WEST)):
        if case & borders == borders:
            one, two, three, four = (int(each[corner]) for each in (nw, sw, se, ne))
            triangles[corner] = [(one, two, four), (two, three, four)]
    triangles = triangles.reshape(-1, 3)
    a, b, c = triangles.T
    return np.asarray(triangles[(a != b) & (b != c) & (a != c)].reshape(-1))


def _corners(vertex: Int64Array) -> tuple[Int64Array, Int64Array, Int64Array, Int64Array]:
    """Return the north-west, north-east, south-west and south-east vertices of each quad."""
    return vertex[:-1, :-1], vertex[:-1, 1:], vertex[1:, :-1], vertex[1:, 1:]


def _cut(vertex: Int64Array) -> Int64Array:
    """Return the two triangles of each quad, shape (rows, columns, 2, 3)."""
    nw, ne, sw, se = _corners(vertex)
    return np.stack([np.stack([nw, sw, se], -1), np.stack([nw, se, ne], -1)], axis=2)
