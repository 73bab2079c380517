"""Draped features cut at the sides of triangles (Sun et al. 2008, sections 3.2 and 3.3).

Strokes become one convex piece a segment, divided from its neighbours along the bisectors of their corners,
and areas the triangles of a constrained Delaunay triangulation. Pieces are clipped to the triangles that they
meet, which are found row by row of the triangles' grid.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import Bounds, Float64Array, Int64Array
from sketchterrain.features.items import AFTER, BEFORE, ENDS, FILL, POINT, STARTS, Items
from sketchterrain.geometry.box_index import expanded
from sketchterrain.host.library import host_function
from sketchterrain.tiles.quadtree import tile_indices

VERTEX: Final = np.dtype([("corners", "<u2", 4), ("weights", "<f4", 2), ("place", "<f4", 2), ("part", "<u4")])
"""A vertex on a triangle: numbers of its corners, weights of the second and third, place in its part."""
PART: Final = np.dtype([("length", "<f4"), ("along", "<f4"), ("style", "<f4"), ("flags", "<f4")])
"""What a piece is part of: a segment (m), how far along its line it starts (m), its style, and flags."""
IS_FILL, IS_POINT = 16, 32  # flags beside those of `Items.ends`
_MOST: Final = 16  # corners of a clipped piece
_TOUCH: Final = 1e-3  # of a quad, by which triangles that meet it reach into it at least


class ConvexPieces(NamedTuple):
    """Convex pieces of features in the order in which they are drawn."""

    corners: Float64Array  # (n, _MOST, 2) m
    counts: Int64Array  # (n,) corners
    frame: Float64Array  # (n, 4) m: origin and direction of the piece's own coordinates
    parts: npt.NDArray[np.void]  # (n,) of PART

    @classmethod
    def of_items(cls, items: Items, reach: Float64Array, angles: Float64Array) -> ConvexPieces:
        """Return the pieces of items, strokes and points within `reach` (m) of theirs (styles,).

        Places in areas are along and across `angles` (styles,), the directions (rad) of their hatches.
        """
        fills = items.kind == FILL
        # Runs of fills of one feature are one area.
        other = np.diff([items.feature, items.style, fills], axis=1).any(axis=0)
        starts = np.flatnonzero(np.append(True, other | ~fills[1:])[: len(fills)])
        strokes, owner = _strokes(items.taken(~fills), reach)
        found, owners = [strokes], [np.flatnonzero(~fills)[owner]]
        for start, end in pairwise([*starts.tolist(), len(fills)]):
            if fills[start]:
                found.append(_area(items, start, end, float(angles[items.style[start]])))
                owners.append(np.full(len(found[-1].counts), start))
        order = np.argsort(np.concatenate(owners), kind="stable")
        return cls(*(np.concatenate(each)[order] for each in zip(*found, strict=True)))


def _area(items: Items, start: int, end: int, angle: float) -> ConvexPieces:
    """Return the triangles of an area: shells less holes."""
    sides: tuple[list[shapely.Geometry], list[shapely.Geometry]] = ([], [])
    for first, last in pairwise(items.first[start : end + 1]):
        ring = items.points[first:last]
        if len(ring) > 3:
            turn = np.sum(ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1])
            sides[int(turn < 0.0)].append(shapely.make_valid(shapely.Polygon(ring)))
    covered = shapely.difference(*map(shapely.union_all, sides))
    found = shapely.orient_polygons(shapely.get_parts(shapely.constrained_delaunay_triangles(covered)))
    triangles = shapely.get_coordinates(found).reshape(-1, 4, 2)[:, :3]
    corners = np.zeros((len(triangles), _MOST, 2))
    corners[:, :3] = triangles
    parts = np.zeros(len(triangles), PART)
    parts["style"], parts["flags"] = items.style[start], IS_FILL
    frame = np.tile([0.0, 0.0, np.cos(angle), np.sin(angle)], (len(triangles), 1))
    return ConvexPieces(corners, np.full(len(triangles), 3), frame, parts)


def _strokes(items: Items, reach: Float64Array) -> tuple[ConvexPieces, Int64Array]:
    """Return the pieces of lines and points, all within `reach` that is nearest to a segment; their items."""
    is_new = np.ones(len(items.points), bool)
    is_new[1:] = (items.points[1:] != items.points[:-1]).any(axis=1)
    is_new[items.first[:-1]] = True
    first = np.append(0, np.cumsum(is_new))[items.first]  # without repeated points
    size = np.diff(first)
    ends = np.where(items.kind == POINT, IS_POINT, items.ends).astype(np.int64)
    before = ((ends & BEFORE) > 0) & (size > 2)
    after = ((ends & AFTER) > 0) & (size - before > 2)
    owner, place = expanded(np.maximum(size - before - after - 1, 1))
    place += before[owner]
    n = len(owner)
    corners, count, frame = np.empty((n, _MOST, 2)), np.empty(n, np.int64), np.empty((n, 4))
    length, along, reaches = np.empty(n), np.empty(n), reach[items.style]
    lines = items.points[is_new], first, reaches, owner, place
    host_function("stroke_pieces")(*lines, corners, count, frame, length, along)
    parts = np.zeros(n, PART)
    parts["length"], parts["along"], parts["style"] = length, along + items.along[owner], items.style[owner]
    ends, size = ends[owner], size[owner]
    parts["flags"] = ends & (IS_POINT | STARTS * (place == 0) | ENDS * (place >= size - 2))
    return ConvexPieces(corners, count, frame, parts), owner


class QuadMesh(NamedTuple):
    """Triangles on a grid of quads, and those that meet each quad."""

    numbers: Int64Array  # (t, 3) vertices, in rows from north to south
    corners: Float64Array  # (t, 3, 2) columns eastward and rows southward
    first: Int64Array  # (quads² + 1,) into `met`
    met: Int64Array


@cache
def mesh_of(quads: int, case: int) -> QuadMesh:
    """Return the triangles of a tile in a border case of `tile_indices`."""
    indices, starts, counts = tile_indices(quads)
    numbers = indices[starts[case] : starts[case] + counts[case]].astype(np.int64).reshape(-1, 3)
    corners = np.stack([numbers % (quads + 1), numbers // (quads + 1)], axis=-1).astype(np.float64)
    count, border = np.full(len(corners), 3), np.full(len(corners), -_TOUCH)
    cell, met = cells_met(corners, count, border, quads)
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(quads * quads + 1))
    return QuadMesh(numbers, corners, first, met[order])


def cut(pieces: ConvexPieces, mesh: QuadMesh, box: Bounds) -> npt.NDArray[np.void]:
    """Return pieces cut at the sides of a mesh that fills a box (m), as triangles (n,) of VERTEX."""
    quads = round(np.sqrt(len(mesh.first) - 1))
    west, north, cell = box[0], box[3], (box[2] - box[0]) / quads
    local = (pieces.corners - [west, north]) * [1.0 / cell, -1.0 / cell]
    met = cells_met(local, pieces.counts, np.zeros(len(local)), quads)
    triangle, part, columns, rows = _cut(local, pieces.counts, *met, mesh)
    a, b, c = (mesh.corners[triangle, k].T for k in range(3))
    (p, q), (s, t), (x, y) = b - a, c - a, (columns, rows) - a
    vertices = np.empty(len(part), VERTEX)
    vertices["corners"][:, :3], vertices["corners"][:, 3] = mesh.numbers[triangle], 0
    weights = np.stack([x * t - y * s, p * y - q * x]) / (p * t - q * s)
    vertices["weights"], vertices["part"] = weights.T, part
    frame = pieces.frame[part]
    x, y = west + cell * columns - frame[:, 0], north - cell * rows - frame[:, 1]
    vertices["place"][:, 0] = x * frame[:, 2] + y * frame[:, 3]
    vertices["place"][:, 1] = y * frame[:, 2] - x * frame[:, 3]
    return vertices


def cells_met(
    polygons: Float64Array, count: Int64Array, border: Float64Array, cells: int
) -> tuple[Int64Array, Int64Array]:
    """Return the cells of a grid that polygons meet, and the polygons' numbers, ascending.

    Polygons are widened by a border (n,). All lengths are in cells, `cells` along a side.
    """
    kinds = np.int64, np.int64
    found, number = _all_found("cells_met", kinds, 4 * len(polygons), polygons, count, border, cells)
    return found, number


def _cut(
    polygons: Float64Array, count: Int64Array, cells: Int64Array, owners: Int64Array, mesh: QuadMesh
) -> list[npt.NDArray[Any]]:
    """Clip polygons to triangles that meet their cells: each vertex's triangle, polygon, column and row."""
    stamp = np.empty(len(mesh.corners), np.int64)
    fixed = polygons, count, cells, owners, mesh.corners, mesh.first, mesh.met, stamp
    return _all_found("cut_polygons", (np.int64, np.int64, np.float64, np.float64), 16 * len(cells), *fixed)


def _all_found(name: str, kinds: tuple[type, ...], room: int, *arguments: Any) -> list[npt.NDArray[Any]]:
    """Return all that a loop finds, which fits into arrays of a size or tells a size that it needs."""
    while True:
        found: list[npt.NDArray[Any]] = [np.empty(room, kind) for kind in kinds]
        count = host_function(name)(*arguments, *found)
        if count <= room:
            return [each[:count] for each in found]
        room = count
