"""Draped features cut at the sides of triangles (Sun et al. 2008, sections 3.2 and 3.3).

Strokes become one convex piece a segment, divided from its neighbours along the bisectors of their corners,
and areas the triangles of a constrained Delaunay triangulation. Pieces are clipped to the triangles that they
meet, which are found row by row of the triangles' grid.
"""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from numba import njit

from sketchterrain.array_types import Bounds, Float64Array, Int64Array
from sketchterrain.drape.items import AFTER, BEFORE, ENDS, FILL, POINT, STARTS, Items
from sketchterrain.tiles.quadtree import tile_indices

VERTEX: Final = np.dtype([("corners", "<u2", 4), ("weights", "<f4", 2), ("place", "<f4", 2), ("part", "<u4")])
"""A vertex on a triangle: numbers of its corners, weights of the second and third, place in its part."""
PART: Final = np.dtype([("length", "<f4"), ("along", "<f4"), ("style", "<f4"), ("flags", "<f4")])
"""What a piece is part of: a segment (m), how far along its line it starts (m), its style, and flags."""
IS_FILL, IS_POINT = 16, 32  # flags beside those of `Items.ends`
_MOST: Final = 16  # corners of a clipped piece
_ANGLE: Final = 1e-9  # least squared length of the sum of two directions that have a bisector

_compiled = njit(cache=True, nogil=True)


class Pieces(NamedTuple):
    """Convex pieces of features in the order in which they are drawn."""

    corners: Float64Array  # (n, _MOST, 2) m
    counts: Int64Array  # (n,) corners
    frame: Float64Array  # (n, 4) m: origin and direction of the piece's own coordinates
    parts: npt.NDArray[np.void]  # (n,) of PART

    @classmethod
    def of_items(cls, items: Items, reach: Float64Array, angles: Float64Array) -> Pieces:
        """Return the pieces of items, strokes and points within `reach` (m) of theirs (styles,).

        Places in areas are along and across `angles` (styles,), the directions (rad) of their hatches.
        """
        found: list[Pieces] = []
        fills = items.kind == FILL
        # Runs of fills of one feature are one area.
        starts = np.flatnonzero(
            np.append(True, (np.diff(items.feature) != 0) | (np.diff(fills) != 0) | ~fills[1:])
        )
        if not len(items.kind):
            return cls.joined([])
        for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(fills)], strict=True):
            style = int(items.style[start])
            if fills[start]:
                found.append(_area(items, start, end, float(angles[style])))
                continue
            line = items.points[items.first[start] : items.first[start + 1]]
            is_point = items.kind[start] == POINT
            ends = IS_POINT if is_point else int(items.ends[start])
            corners, count, frame, lengths, along, flags = _strips(line, ends, float(reach[style]))
            parts = np.zeros(len(count), PART)
            parts["length"], parts["along"], parts["style"] = lengths, along + items.along[start], style
            parts["flags"] = IS_POINT if is_point else flags
            found.append(cls(corners, count, frame, parts))
        return cls.joined(found)

    @classmethod
    def joined(cls, found: list[Pieces]) -> Pieces:
        """Return all pieces of several, one after the other."""
        empty = cls(np.zeros((0, _MOST, 2)), np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0, PART))
        return cls(*(np.concatenate(each) for each in zip(empty, *found, strict=True)))


def _area(items: Items, start: int, end: int, angle: float) -> Pieces:
    """Return the triangles of an area: shells less holes."""
    rings = [items.points[items.first[at] : items.first[at + 1]] for at in range(start, end)]
    rings = [ring for ring in rings if len(ring) > 3]
    turns = [float(np.sum(ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1])) for ring in rings]
    sums = [
        shapely.union_all(
            [
                shapely.make_valid(shapely.Polygon(ring))
                for ring, turn in zip(rings, turns, strict=True)
                if turn * sign > 0
            ]
        )
        for sign in (1.0, -1.0)
    ]
    covered = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.difference(*sums)))
    triangles = shapely.get_coordinates(covered).reshape(-1, 4, 2)[:, :3]
    corners = np.zeros((len(triangles), _MOST, 2))
    corners[:, :3] = triangles
    # Counterclockwise.
    one, two = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    turned = one[:, 0] * two[:, 1] < one[:, 1] * two[:, 0]
    corners[turned, 1], corners[turned, 2] = triangles[turned, 2], triangles[turned, 1]
    parts = np.zeros(len(triangles), PART)
    parts["style"], parts["flags"] = items.style[start], IS_FILL
    frame = np.tile([0.0, 0.0, np.cos(angle), np.sin(angle)], (len(triangles), 1))
    return Pieces(corners, np.full(len(triangles), 3), frame, parts)


@_compiled  # type: ignore[untyped-decorator] # numba has no types
def clip_polygon(
    polygon: Float64Array, count: int, a: float, b: float, c: float, result: Float64Array
) -> int:
    """Clip a convex polygon to a·x + b·y ≤ c (Sutherland and Hodgman); return the number of corners."""
    kept = 0
    for k in range(count):
        x, y = polygon[k, 0], polygon[k, 1]
        next_ = k + 1 if k + 1 < count else 0
        p, q = polygon[next_, 0], polygon[next_, 1]
        here, there = a * x + b * y - c, a * p + b * q - c
        if here <= 0.0:
            result[kept, 0], result[kept, 1] = x, y
            kept += 1
        if (here < 0.0 < there) or (there < 0.0 < here):
            share = here / (here - there)
            result[kept, 0], result[kept, 1] = x + share * (p - x), y + share * (q - y)
            kept += 1
    return kept


@_compiled  # type: ignore[untyped-decorator]
def _strips(
    line: Float64Array, ends: int, reach: float
) -> tuple[Float64Array, Int64Array, Float64Array, Float64Array, Float64Array, Int64Array]:
    """Return the pieces of a run of a line: all within `reach` that is nearest to each segment."""
    points = np.empty_like(line)
    n, first, last = 0, 0, 0
    for k in range(len(line)):  # without repeated points, unless there is only one
        if n == 0 or line[k, 0] != points[n - 1, 0] or line[k, 1] != points[n - 1, 1]:
            points[n] = line[k]
            n += 1
    first = 1 if ends & BEFORE and n > 2 else 0
    last = n - 2 if ends & AFTER and n - first > 2 else n - 1
    size = max(last - first, 1)
    corners, count = np.zeros((size, _MOST, 2)), np.zeros(size, np.int64)
    frame, lengths, along = np.zeros((size, 4)), np.zeros(size), np.zeros(size)
    flags = np.zeros(size, np.int64)
    buffer = np.zeros((_MOST, 2))
    walked = 0.0
    for k in range(size):
        at = first + k
        x, y = points[at, 0], points[at, 1]
        to = min(at + 1, n - 1)
        length = np.hypot(points[to, 0] - x, points[to, 1] - y)
        u = (points[to, 0] - x) / length if length > 0.0 else 1.0
        v = (points[to, 1] - y) / length if length > 0.0 else 0.0
        for corner, (s, t) in enumerate(((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))):
            forward = length + reach if s > 0.0 else -reach
            corners[k, corner, 0] = x + forward * u - t * reach * v
            corners[k, corner, 1] = y + forward * v + t * reach * u
        count[k] = 4
        frame[k] = (x, y, u, v)
        lengths[k], along[k] = length, walked
        walked += length
        flags[k] = (STARTS if at == 0 and ends & STARTS else 0) | (ENDS if to == n - 1 and ends & ENDS else 0)
        for other, sign in ((at - 1, -1.0), (to + 1, 1.0)):  # the segments before and after
            if other < 0 or other >= n or length == 0.0:
                continue
            end = at if sign < 0.0 else to
            p, q = sign * (points[other, 0] - points[end, 0]), sign * (points[other, 1] - points[end, 1])
            away = np.hypot(p, q)
            a, b = u + p / away, v + q / away
            if a * a + b * b < _ANGLE:
                continue
            a, b = sign * a, sign * b
            count[k] = clip_polygon(
                corners[k], count[k], a, b, a * points[end, 0] + b * points[end, 1], buffer
            )
            corners[k] = buffer
    return corners, count, frame, lengths, along, flags


class Mesh(NamedTuple):
    """Triangles on a grid of quads, and those that meet each quad."""

    numbers: Int64Array  # (t, 3) vertices, in rows from north to south
    corners: Float64Array  # (t, 3, 2) columns eastward and rows southward
    first: Int64Array  # (quads² + 1,) into `met`
    met: Int64Array


@cache
def mesh_of(quads: int, case: int) -> Mesh:
    """Return the triangles of a tile in a border case of `tile_indices`."""
    indices, first, count = tile_indices(quads)
    numbers = indices[first[case] : first[case] + count[case]].astype(np.int64).reshape(-1, 3)
    corners = np.stack([numbers % (quads + 1), numbers // (quads + 1)], axis=-1).astype(np.float64)
    low, high = corners.min(axis=1).astype(np.int64), corners.max(axis=1).astype(np.int64)
    pairs = [
        (row * quads + column, triangle)
        for triangle, ((west, north), (east, south)) in enumerate(
            zip(low.tolist(), high.tolist(), strict=True)
        )
        for row in range(north, south)
        for column in range(west, east)
    ]
    cell, met = np.array(sorted(pairs), np.int64).T
    return Mesh(
        numbers, corners, np.searchsorted(cell, np.arange(quads * quads + 1)), np.ascontiguousarray(met)
    )


def cut(pieces: Pieces, mesh: Mesh, box: Bounds) -> npt.NDArray[np.void]:
    """Return pieces cut at the sides of a mesh that fills a box (m), as triangles (n,) of VERTEX."""
    quads = round(np.sqrt(len(mesh.first) - 1))
    west, north, cell = box[0], box[3], (box[2] - box[0]) / quads
    local = (pieces.corners - [west, north]) * [1.0 / cell, -1.0 / cell]
    numbers, values, part = _cut(local, pieces.counts, *mesh, quads)
    vertices = np.empty(len(part), VERTEX)
    vertices["corners"][:, :3], vertices["corners"][:, 3] = numbers, 0
    vertices["weights"], vertices["part"] = values[:, :2], part
    frame = pieces.frame[part]
    x, y = west + cell * values[:, 2] - frame[:, 0], north - cell * values[:, 3] - frame[:, 1]
    vertices["place"][:, 0] = x * frame[:, 2] + y * frame[:, 3]
    vertices["place"][:, 1] = y * frame[:, 2] - x * frame[:, 3]
    return vertices


@_compiled  # type: ignore[untyped-decorator]
def _cut(
    polygons: Float64Array,
    count: Int64Array,
    numbers: Int64Array,
    corners: Float64Array,
    first: Int64Array,
    met: Int64Array,
    quads: int,
) -> tuple[Int64Array, Float64Array, Int64Array]:
    """Clip polygons to all triangles that they meet.

    Return, per vertex, the numbers of a triangle's corners, the weights of the second and the third, column
    and row, and the polygon.
    """
    space, used = 256, 0
    found, values, part = np.empty((space, 3), np.int64), np.empty((space, 4)), np.empty(space, np.int64)
    stamp = np.full(len(numbers), -1, np.int64)
    one, two = np.zeros((2 * _MOST, 2)), np.zeros((2 * _MOST, 2))
    for number in range(len(polygons)):
        polygon, n = polygons[number], count[number]
        if n < 3:
            continue
        low, high = polygon[:n, 1].min(), polygon[:n, 1].max()
        for row in range(max(int(np.floor(low)), 0), min(int(np.floor(high)), quads - 1) + 1):
            kept = clip_polygon(polygon, n, 0.0, -1.0, -float(row), one)
            kept = clip_polygon(one, kept, 0.0, 1.0, row + 1.0, two)
            if not kept:
                continue
            west, east = two[:kept, 0].min(), two[:kept, 0].max()
            for column in range(max(int(np.floor(west)), 0), min(int(np.floor(east)), quads - 1) + 1):
                cell = row * quads + column
                for at in range(first[cell], first[cell + 1]):
                    triangle = met[at]
                    if stamp[triangle] == number:
                        continue
                    stamp[triangle] = number
                    a, b, c = corners[triangle]
                    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
                    one[:n] = polygon[:n]
                    kept = n
                    for p, q in ((a, b), (b, c), (c, a)):
                        # Counterclockwise from above, and rows run southward.
                        s, t = p[1] - q[1], q[0] - p[0]
                        kept = clip_polygon(one, kept, s, t, s * p[0] + t * p[1], two)
                        one, two = two, one
                        if kept < 3:
                            break
                    if kept < 3:
                        continue
                    while used + 3 * (kept - 2) > space:
                        found, values, part = (
                            np.concatenate((found, found)),
                            np.concatenate((values, values)),
                            np.concatenate((part, part)),
                        )
                        space *= 2
                    for fan in range(1, kept - 1):
                        for k in (0, fan, fan + 1):
                            x, y = one[k, 0], one[k, 1]
                            values[used, 0] = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
                            values[used, 1] = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
                            values[used, 2], values[used, 3] = x, y
                            found[used] = numbers[triangle]
                            part[used] = number
                            used += 1
    return found[:used], values[:used], part[:used]
