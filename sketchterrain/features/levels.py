"""Drawable parts of vector features at levels of detail, stored on disk and mapped into memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array, StructuredArray
from sketchterrain.features.files import valid_areas
from sketchterrain.features.items import AFTER, BEFORE, ENDS, FILL, POINT, STARTS, STROKE
from sketchterrain.features.table import Shapes, single_parts
from sketchterrain.geometry.box_index import expanded

RUN: Final = 64
"""The most segments of a line in one item."""
PIECE: Final = 256
"""The most vertices of an area in one item, unless they lie on less than a micrometre."""

_GROUP: Final = 64  # neighbouring items with a common box
_SPLITS: Final = 48  # the most cuts of an area, one in another
_LOST: Final = 0.125  # of the tolerance: lines shorter than that are left out
_POINT, _LINE, _POLYGON = 0, 1, 3  # shapely's type ids

ITEM: Final = np.dtype(
    [
        ("box", np.float32, 4),  # m: west, south, east, north, rounded outward
        ("along", np.float64),  # m along the line
        ("first", np.int64),  # of its points
        ("feature", np.int32),
        ("count", np.int32),  # of points
        ("kind", np.int8),
        ("ends", np.uint8),
    ],
    align=True,
)


class Parts(NamedTuple):
    """Items and their points."""

    items: StructuredArray  # of ITEM
    points: Float64Array  # (k, 2) m


class Outlines(NamedTuple):
    """Lines and rings, one after the other."""

    points: Float64Array  # (k, 2) m
    start: Int64Array  # (n + 1,) of each one's points
    feature: Int64Array  # (n,)
    is_area: BoolArray  # (n,) whether it is a ring: shells run counterclockwise, holes clockwise
    along: Float64Array  # (k,) m from its first point


class Shapes2D(NamedTuple):
    """Points and outlines of features."""

    points: Float64Array  # (n, 2) m
    feature: Int64Array  # (n,) of each point
    outlines: Outlines


def split_shapes(shapes: Shapes, feature: Int64Array) -> Shapes2D:
    """Return the points and outlines of features; areas that cross themselves are made valid."""
    parts, of = single_parts(valid_areas(shapes), np.arange(len(shapes)))
    filled = ~shapely.is_empty(parts)
    parts, of = parts[filled], feature[of[filled]]
    kind = shapely.get_type_id(parts)
    rings, ring_of = shapely.get_rings(shapely.orient_polygons(parts[kind == _POLYGON]), return_index=True)
    lines = np.concatenate([parts[kind == _LINE], rings])
    points, at = shapely.get_coordinates(lines, return_index=True)
    start = np.append(0, np.cumsum(np.bincount(at, minlength=len(lines))))
    is_area = np.arange(len(lines)) >= (kind == _LINE).sum()
    owner = np.concatenate([of[kind == _LINE], of[kind == _POLYGON][ring_of]])
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))[: len(points)]
    outlines = Outlines(points, start, owner, is_area, along - along[start[at]])
    return Shapes2D(shapely.get_coordinates(parts[kind == _POINT]), of[kind == _POINT], outlines)


def generalised(outlines: Outlines, tolerance: float) -> Outlines:
    """Return outlines with vertices rounded to multiples of `tolerance` (m), without needless ones.

    A vertex is rounded alike in all lines, and what is removed lies on the line to the bit, so that shared
    borders stay shared. A line that collapses becomes its longest chord if that is an eighth of it or longer.
    """
    points, start = outlines.points, outlines.start
    owner, _ = expanded(np.diff(start))
    rounded = np.rint(points / tolerance) if tolerance else points
    keep = np.ones(len(points), bool)
    keep[1:] = (np.diff(rounded, axis=0) != 0.0).any(axis=1)
    keep[start[:-1]] = True
    if tolerance:
        keep[keep] = ~_straight(rounded[keep], owner[keep])
    left = np.bincount(owner[keep], minlength=len(outlines.feature))
    result = rounded * tolerance if tolerance else points
    chord = np.flatnonzero(left == 1)
    if len(chord):
        inner = (left == 1)[owner]
        reach = np.hypot(*(points - points[start[owner]]).T)
        longest = np.maximum.reduceat(reach, start[:-1])
        far = np.flatnonzero(inner & (reach == longest[owner]) & (longest[owner] > _LOST * tolerance))
        _, first = np.unique(owner[far], return_index=True)
        keep[start[chord]] = False
        keep[far[first]] = keep[start[owner[far[first]]]] = True
        result = np.where(inner[:, None], points, result)
    left = np.bincount(owner[keep], minlength=len(outlines.feature))
    start = np.append(0, np.cumsum(left[left > 0]))
    lines = outlines.feature[left > 0], outlines.is_area[left > 0]
    return Outlines(result[keep], start, *lines, outlines.along[keep])


def _straight(points: Float64Array, owner: Int64Array) -> BoolArray:
    """Return which vertices lie between their neighbours on a straight line."""
    found = np.zeros(len(points), bool)
    (x, y), (u, v) = np.diff(points, axis=0)[:-1].T, np.diff(points, axis=0)[1:].T
    found[1:-1] = (x * v == y * u) & (x * u + y * v > 0.0) & (owner[2:] == owner[:-2])
    return found


def parts_of(shapes: Shapes2D, tolerance: float) -> Parts:
    """Return all items of features for a tolerance (m); 0 keeps every vertex."""
    outlines = generalised(shapes.outlines, tolerance)
    dots = np.zeros(len(shapes.points), ITEM)
    dots["kind"], dots["count"], dots["feature"] = POINT, 1, shapes.feature
    return joined([_fills(outlines), _strokes(outlines), _boxed(dots, shapes.points)])


def joined(parts: Sequence[Parts]) -> Parts:
    """Return the items of several, one after the other."""
    items = np.concatenate([part.items for part in parts])
    counts = [len(part.items) for part in parts]
    items["first"] += np.repeat(np.cumsum([0, *(len(part.points) for part in parts[:-1])]), counts)
    return Parts(items, np.concatenate([part.points for part in parts]))


def _boxed(items: StructuredArray, points: Float64Array) -> Parts:
    """Return items, whose points follow one another, with their places and boxes."""
    items["first"] = np.cumsum(items["count"]) - items["count"]
    low, high = (reduce.reduceat(points, items["first"]) for reduce in (np.minimum, np.maximum))
    items["box"][:, :2] = np.nextafter(low.astype(np.float32), np.float32(-np.inf))
    items["box"][:, 2:] = np.nextafter(high.astype(np.float32), np.float32(np.inf))
    return Parts(items, points)


def _strokes(outlines: Outlines) -> Parts:
    """Return runs of lines and rings."""
    points, start = outlines.points, outlines.start
    segments = np.diff(start) - 1
    closed = (points[start[:-1]] == points[start[1:] - 1]).all(axis=1) & (segments > 1)
    runs = -(-segments // RUN)
    line, run = expanded(runs)
    begin = run * RUN
    end = np.minimum(begin + RUN, segments[line])
    starts, ends = begin == 0, end == segments[line]
    before, after = ~starts | closed[line], ~ends | closed[line]
    items = np.zeros(len(line), ITEM)
    items["kind"], items["feature"] = STROKE, outlines.feature[line]
    items["along"] = outlines.along[start[line] + begin]
    bits = (starts & ~before, STARTS), (ends & ~after, ENDS), (before, BEFORE), (after, AFTER)
    items["ends"] = sum((mask * np.uint8(bit) for mask, bit in bits), np.zeros(len(line), np.uint8))
    items["count"] = end - begin + 1 + before + after
    owner, place = expanded(items["count"])
    vertex, last = (begin - before)[owner] + place, segments[line][owner]
    vertex = np.where(vertex < 0, last - 1, np.where(vertex > last, 1, vertex))
    return _boxed(items, points[start[line][owner] + vertex])


def _fills(outlines: Outlines) -> Parts:
    """Return rings with an inside, large ones in pieces."""
    count = np.diff(outlines.start)
    ring = np.flatnonzero(outlines.is_area & (count > 3))
    small = ring[count[ring] <= PIECE]
    owner, place = expanded(count[small])
    chunks, sizes = [outlines.points[outlines.start[small][owner] + place]], [count[small]]
    features = [outlines.feature[small]]
    for large in ring[count[ring] > PIECE]:
        pieces = subdivided(outlines.points[outlines.start[large] : outlines.start[large + 1]])
        chunks += pieces
        sizes.append(np.array([len(piece) for piece in pieces], np.int64))
        features.append(np.full(len(pieces), outlines.feature[large]))
    items = np.zeros(sum(map(len, features)), ITEM)
    items["kind"], items["feature"] = FILL, np.concatenate(features)
    items["count"] = np.concatenate(sizes)
    return _boxed(items, np.concatenate(chunks))


def subdivided(ring: Float64Array) -> list[Float64Array]:
    """Return pieces of a closed ring with at most `PIECE` vertices each, whose signed areas add up to its.

    Its box is halved along the longer side, as PostGIS does in ST_Subdivide. Pieces are clipped by the rule
    of Sutherland and Hodgman, so that they may have edges there and back, which cancel.
    """
    pieces, pending = list[Float64Array](), [(ring, 0)]
    while pending:
        ring, cuts = pending.pop()
        size = np.ptp(ring, axis=0)
        axis = int(size[1] > size[0])
        if len(ring) <= PIECE or cuts == _SPLITS or size[axis] < 1e-6:
            pieces.append(ring)
            continue
        middle = float(ring[:, axis].min() + 0.5 * size[axis])
        halves = (_clipped(ring, axis, middle, sign) for sign in (1.0, -1.0))
        pending += [(half, cuts + 1) for half in halves if len(half) > 3]
    return pieces


def _clipped(ring: Float64Array, axis: int, middle: float, sign: float) -> Float64Array:
    """Return the part of a closed ring on one side of a line."""
    side = sign * (ring[:, axis] - middle)
    crosses = (side[:-1] <= 0.0) != (side[1:] <= 0.0)
    share = side[:-1] / np.where(crosses, side[:-1] - side[1:], 1.0)
    vertices = np.stack([ring[:-1], ring[:-1] + share[:, None] * np.diff(ring, axis=0)], axis=1)
    vertices[:, 1, axis] = middle
    part = vertices[np.stack([side[:-1] <= 0.0, crosses], axis=1)]
    # There and back along a cut, or straight on along it, is needless.
    part = part[(part != np.roll(part, 1, axis=0)).any(axis=1)]
    level = part == np.roll(part, 1, axis=0)
    part = part[~(level & np.roll(level, -1, axis=0)).any(axis=1)]
    return np.concatenate([part, part[:1]])


@dataclass(frozen=True, eq=False)
class Level:
    """Items in an order in which neighbours are near each other, in files or in memory."""

    tolerance: float  # m
    items: StructuredArray  # of ITEM
    points: Float64Array  # (k, 2) m
    groups: npt.NDArray[np.float32]  # (n, 4) common boxes of 64 successive items each

    def touching(self, box: Bounds) -> Int64Array:
        """Return the numbers of items whose boxes touch a box, ascending."""
        near = np.flatnonzero(touch(self.groups, box))
        number = (near[:, None] * _GROUP + np.arange(_GROUP)).ravel()
        number = number[number < len(self.items)]
        return number[touch(self.items["box"][number], box)]

    def vertices(self, items: StructuredArray) -> Float64Array:
        """Return the points of items, one after the other."""
        return np.asarray(self.points[places(items)])


def places(items: StructuredArray) -> Int64Array:
    """Return the numbers of the points of items, one after the other."""
    owner, place = expanded(items["count"])
    return np.asarray(items["first"][owner] + place)


def level_of(parts: Parts, tolerance: float) -> Level:
    """Return a level in memory of a few items."""
    return Level(tolerance, *parts, common(parts.items["box"]))


def common(boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the common boxes of 64 successive items each."""
    at = np.arange(0, len(boxes), _GROUP)
    low, high = np.minimum.reduceat(boxes[:, :2], at), np.maximum.reduceat(boxes[:, 2:], at)
    return np.concatenate([low, high], axis=1)


def touch(boxes: npt.NDArray[np.float32], box: Bounds) -> BoolArray:
    """Return which boxes (n, 4) touch another."""
    west, south, east, north = box
    return np.asarray(
        (boxes[:, 0] <= east) & (boxes[:, 2] >= west) & (boxes[:, 1] <= north) & (boxes[:, 3] >= south)
    )


def morton(boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.uint64]:
    """Return the place of boxes' middles on a Z-order curve over all of them."""
    if not len(boxes):
        return np.zeros(0, np.uint64)
    middle = 0.5 * (boxes[:, :2] + boxes[:, 2:]).astype(np.float64)
    low, size = middle.min(axis=0), np.maximum(np.ptp(middle, axis=0).max(), 1e-9)
    cell = ((middle - low) * (65535.0 / size)).astype(np.uint64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cell = (cell | cell << np.uint64(shift)) & np.uint64(mask)
    return np.asarray(cell[:, 0] | cell[:, 1] << np.uint64(1))
