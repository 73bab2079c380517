"""Painting on label images: brush strokes, lines, flood fill, picking."""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Float64Array
from sketchterrain.document.label_layers import Box, LabelImage, union_box
from sketchterrain.document.sketch import Sketch
from sketchterrain.geometry.splines import cubics
from sketchterrain.landforms.placement.heights import ShapeHeight, shape_height
from sketchterrain.landforms.placement.shapes import find_regions, measure_shape
from sketchterrain.schema.layers import LANE_WIDTHS, LAYERS

_MEASURED = 256  # px along a side on which shapes are measured while they are painted


def flood_fill(image: LabelImage, row: int, column: int, label: int) -> Box | None:
    """Relabel the region around a pixel of an image in place; return its box, None if nothing changes.

    An unpainted region is bounded by any paint, also by a diagonal line one pixel wide (4-connected); a
    painted region is the whole shape, as placement sees it (8-connected).
    """
    if not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]) or image[row, column] == label:
        return None
    below = image[row, column]
    regions, _ = ndimage.label(image == below, np.ones((3, 3)) if below else None)
    filled = regions == regions[row, column]
    image[filled] = label
    rows, columns = np.flatnonzero(filled.any(axis=1)), np.flatnonzero(filled.any(axis=0))
    return int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1


def pick(layers: Iterable[tuple[str, LabelImage]], row: int, column: int) -> tuple[str, int] | None:
    """Return the layer and label of the topmost paint at a pixel; layers are ordered from the top."""
    for name, image in layers:
        if 0 <= row < image.shape[0] and 0 <= column < image.shape[1] and image[row, column]:
            return name, int(image[row, column])
    return None


Dab = tuple[float, float, float]
"""Centre (px right, px down; pixel centres at +0.5) and radius (px) of a disc."""
THINNEST = 0.5  # radius (px) of the thinnest brush: a line one pixel wide

_GRID = 1024.0
_TOLERANCE = 1e-9  # px beyond an edge at which a pixel centre counts as covered
_SPACING = 2.0  # grains between nodes
_MAX_SHIFT = 0.5  # of that: by which smoothing moves a node
_SAGITTA = 0.1  # px between a path's straight parts and its curve


def snap(value: float) -> float:
    """Return a coordinate rounded to 1/1024 px.

    Squares of such numbers are exact, so that coverage does not depend on rounding, and a mirrored stroke
    paints the mirrored pixels.
    """
    return round(value * _GRID) / _GRID


def paint_sweep(image: LabelImage, start: Dab, end: Dab, label: int) -> Box | None:
    """Paint the convex hull of two discs in place; return the painted box.

    Equal discs are one dab, which always paints the pixel of its centre.
    """
    top = math.ceil(min(start[1] - start[2], end[1] - end[2], start[1] - 0.5, end[1] - 0.5) - 0.5)
    bottom = math.floor(max(start[1] + start[2], end[1] + end[2], start[1] + 0.5, end[1] + 0.5) - 0.5) + 1
    top, bottom = max(top, 0), min(bottom, image.shape[0])
    if top >= bottom:
        return None
    left, right = _capsule_runs(start, end, np.arange(top, bottom) + 0.5)
    first = np.maximum(np.ceil(left - 0.5), 0.0)
    last = np.minimum(np.floor(right - 0.5) + 1.0, image.shape[1])
    rows = np.flatnonzero(first < last)
    if not len(rows):
        return None
    for row, begin, stop in zip(
        (rows + top).tolist(), first[rows].astype(int).tolist(), last[rows].astype(int).tolist(), strict=True
    ):
        image[row, begin:stop] = label
    return int(rows[0]) + top, int(first[rows].min()), int(rows[-1]) + top + 1, int(last[rows].max())


def _capsule_runs(start: Dab, end: Dab, y: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return where each row is entered and left, px; where nothing is covered it is left before."""
    left, right = np.full(len(y), np.inf), np.full(len(y), -np.inf)
    for centre_x, centre_y, radius in (start, end) if start != end else (start,):
        square = radius * radius - (y - centre_y) ** 2
        half = np.sqrt(np.maximum(square, 0.0))
        half[square < 0.0] = -np.inf
        if start == end:
            half[np.abs(y - centre_y) <= 0.5] = np.maximum(half[np.abs(y - centre_y) <= 0.5], 0.5)
        left, right = np.minimum(left, centre_x - half), np.maximum(right, centre_x + half)
    for (ax, ay), (bx, by) in _edges(start, end):
        inside = (min(ay, by) - _TOLERANCE <= y) & (y <= max(ay, by) + _TOLERANCE)
        across = ax + (bx - ax) * np.clip((y[inside] - ay) / (by - ay), 0.0, 1.0)
        left[inside] = np.minimum(left[inside], across - _TOLERANCE)
        right[inside] = np.maximum(right[inside], across + _TOLERANCE)
    return left, right


def _edges(start: Dab, end: Dab) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return the two common outer tangents of the discs, without horizontal ones."""
    (ax, ay, a), (bx, by, b) = start, end
    dx, dy = bx - ax, by - ay
    length = math.hypot(dx, dy)
    if length <= abs(b - a):  # one disc is in the other
        return []
    # The normal n of an edge has n·d = a − b: it leans back where the disc grows.
    lean = (a - b) / length
    side = math.sqrt(1.0 - lean * lean)
    edges = []
    for sign in (1.0, -1.0):
        nx = (dx * lean - sign * dy * side) / length
        ny = (dy * lean + sign * dx * side) / length
        low, high = (ax + a * nx, ay + a * ny), (bx + b * nx, by + b * ny)
        if low[1] != high[1]:
            edges.append((low, high))
    return edges


class StrokeSmoother:
    """Reduces pen positions to fewer, smoother path nodes.

    Positions of a slow pen are averaged, and each node is moved a little towards the middle of its
    neighbours: jitter of integer pixels drops to less than half. A fast pen's positions move by at most a
    screen pixel. `grain`: px that positions are quantised to; 0: exact, each position is a node.
    """

    def __init__(self, grain: float) -> None:
        self._spacing = _SPACING * grain
        self._positions: list[Dab] = []
        self._nodes: list[Dab] = []
        self._anchor: Dab | None = None

    def to(self, place: Dab) -> Dab | None:
        """Add a position; return the next path node once it is known."""
        if self._anchor is None:
            self._anchor = place
            self._nodes = [place]
            return place
        self._positions.append(place)
        distance = math.dist(place[:2], self._anchor[:2])
        if distance == 0.0 or distance < self._spacing:
            return None
        self._anchor = place
        node = _mean(self._positions)
        self._positions = []
        if not self._spacing:
            return node
        self._nodes = [*self._nodes[-2:], node]
        return self._smoothed_node() if len(self._nodes) == 3 else None

    def finish(self) -> list[Dab]:
        """Return the remaining nodes; the path ends at the last position."""
        place = self._positions[-1] if self._positions else self._anchor
        if place is None or not self._spacing:
            return []
        self._nodes = [*self._nodes[-2:], place]
        return [self._smoothed_node(), place] if len(self._nodes) == 3 else [place]

    def _smoothed_node(self) -> Dab:
        """Return the smoothed middle one of three nodes."""
        (ax, ay, _), (x, y, radius), (bx, by, _) = self._nodes
        dx, dy = 0.25 * (ax + bx) - 0.5 * x, 0.25 * (ay + by) - 0.5 * y
        share = min(1.0, _MAX_SHIFT * self._spacing / max(math.hypot(dx, dy), 1e-9))
        return snap(x + share * dx), snap(y + share * dy), radius


def _mean(dabs: Sequence[Dab]) -> Dab:
    if len(dabs) == 1:
        return dabs[0]
    x, y, radius = (snap(sum(each) / len(dabs)) for each in zip(*dabs, strict=True))
    return x, y, radius


class Stroke:
    """A round brush stroke on a label image; label 0 erases.

    The path is the centripetal Catmull-Rom spline through the pen's positions, so that sparse positions leave
    no corners. A segment is painted once the next position is known: painting lags one position behind the
    pen, and `finish` paints the last segment. On a straight line the painted pixels do not depend on the
    sampling. `grain`: see `StrokeSmoother`.
    """

    def __init__(self, image: LabelImage, label: int, *, grain: float = 0.0) -> None:
        self._image = image
        self._label = label
        self._smoother = StrokeSmoother(grain)
        self._dabs: list[Dab] = []
        self._last: Dab | None = None

    def to(self, x: float, y: float, radius: float) -> Box | None:
        """Extend the stroke to a position and radius (px); return the painted box."""
        self._last = snap(x), snap(y), max(snap(radius), THINNEST)
        starts = not self._dabs
        node = self._smoother.to(self._last)
        box = None if node is None else self._add(node)
        return union_box(box, self._sweep([self._last, self._last])) if starts else box

    def finish(self) -> Box | None:
        """Paint up to the last position; return the painted box."""
        if self._last is None:
            return None
        box = self._sweep([self._last, self._last])
        for node in self._smoother.finish():
            box = union_box(box, self._add(node))
        near = self._dabs[-3:]
        if len(near) > 1:
            box = union_box(box, self._sweep(smooth_dabs(near, len(near) - 2)))
        return box

    def _add(self, node: Dab) -> Box | None:
        if self._dabs and node[:2] == self._dabs[-1][:2]:
            return None
        self._dabs = [*self._dabs[-3:], node]
        if len(self._dabs) < 3:
            return None
        return self._sweep(smooth_dabs(self._dabs, len(self._dabs) - 3))

    def _sweep(self, path: Sequence[Dab]) -> Box | None:
        box = None
        for start, end in pairwise(path):
            box = union_box(box, paint_sweep(self._image, start, end, self._label))
        return box


def smooth_dabs(dabs: Sequence[Dab], piece: int) -> list[Dab]:
    """Return discs along the spline from ``dabs[piece]`` to ``dabs[piece + 1]``; neighbours must differ.

    Straight lines between them deviate from the curve by at most a tenth of a pixel.
    """
    start, end = dabs[piece], dabs[piece + 1]
    near = np.array(dabs[max(piece - 1, 0) : piece + 3])[:, :2]
    c = cubics(near)[min(piece, 1)]
    chord = near[min(piece, 1) + 1] - near[min(piece, 1)]
    # The curve's second derivative across its chord; uneven speed along it does not matter.
    bends = (c[:, 2], c[:, 2] + 3.0 * c[:, 3])
    across = max(abs(chord[0] * bend[1] - chord[1] * bend[0]) for bend in bends) / math.hypot(*chord)
    count = math.ceil(math.sqrt(across / (4.0 * _SAGITTA)) - 1e-6)
    return [start, *_between(c.tolist(), start[2], end[2], count), end]


def _between(c: list[list[float]], from_radius: float, to_radius: float, count: int) -> Iterator[Dab]:
    for k in range(1, count):
        t = k / count
        x, y = (snap(((d * t + c2) * t + c1) * t + c0) for c0, c1, c2, d in c)
        yield x, y, snap(from_radius + (to_radius - from_radius) * t)


def line_width(sketch: Sketch, layer: str, label: int, brush: float) -> float:
    """Return the width (px) of a line: the label's width property, else the brush's diameter."""
    if "width" not in LAYERS[layer].parameters:
        return 2.0 * brush
    properties = sketch.properties(layer, label)
    width = float(properties["width"] or LANE_WIDTHS.get(layer, 0.0) * properties.get("lanes", 0))
    least = 2.0 * THINNEST if LAYERS[layer].is_painted else 0.0
    return max(width / sketch.pixel_size, least)


def painted_height(sketch: Sketch, layer: str, label: int, image: LabelImage, dab: Dab) -> ShapeHeight | None:
    """Return the height of the painted shape that a dab is part of; None if its layer has no summits.

    Large images are measured in steps of a few pixels.
    """
    if LAYERS[layer].kind != "summits":
        return None
    step = math.ceil(max(image.shape) / _MEASURED)
    small, (x, y, inradius) = image[::step, ::step], dab
    row, column = (
        min(max(math.floor(at / step), 0), n - 1) for at, n in zip((y, x), small.shape, strict=True)
    )
    for region in find_regions(np.where(small == label, small, 0)):
        top, left = row - region.rows.start, column - region.columns.start
        if region.mask[max(top - 1, 0) : max(top + 2, 0), max(left - 1, 0) : max(left + 2, 0)].any():
            inradius = max(inradius, step * float(measure_shape(layer, small.shape, region).depth.max()))
    return shape_height(sketch.properties(layer, label), inradius * sketch.pixel_size, sketch.fidelity)


def line_path(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the smooth curve through points (px) as a polyline, for the preview."""
    return [(x, y) for x, y, _ in _path(points, THINNEST)]


def draw_line(
    image: LabelImage, points: Sequence[tuple[float, float]], width: float, label: int
) -> Box | None:
    """Paint the smooth curve through points (px), with round ends; return the painted box."""
    path = _path(points, max(snap(0.5 * width), THINNEST))
    box = None
    for start, end in [*pairwise(path), *zip(path[:1] + path[-1:], path[:1] + path[-1:], strict=True)]:
        box = union_box(box, paint_sweep(image, start, end, label))
    return box


def _path(points: Sequence[tuple[float, float]], radius: float) -> list[Dab]:
    dabs: list[Dab] = []
    for x, y in points:
        dab = snap(x), snap(y), radius
        if not dabs or dab != dabs[-1]:
            dabs.append(dab)
    path = dabs[:1]
    for piece in range(len(dabs) - 1):
        near = max(piece - 1, 0)
        path += smooth_dabs(dabs[near : piece + 3], piece - near)[1:]
    return path
