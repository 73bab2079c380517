"""Brush strokes, fills and lines on label images."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from sketchterrain.document.label_layers import Box, LabelImage, union_box
from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.hydrology.splines import cubics

_Integers = npt.NDArray[np.int64]


_ROWS = 256  # looked at together: what is compared stays in the cache


def flood_fill(image: LabelImage, row: int, column: int, label: int) -> Box | None:
    """Give the region around a pixel a label.

    Empty ground is bounded by any paint, also by a line that is one pixel wide and goes along a diagonal; a
    painted region is the whole shape, pixels that touch at a corner included, as the terrain knows it.

    Parameters
    ----------
    image : (height, width) uint8
        Painted into.
    row, column
        The pixel.
    label
        0 … 255.

    Returns
    -------
    Box or None
        Around the region; None if nothing changes, or the pixel lies outside of the image.
    """
    if not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]) or image[row, column] == label:
        return None
    starts, ends, rows = _runs(image, int(image[row, column]))
    of = _components(starts, ends, rows, touch=int(image[row, column] != 0))
    first = np.searchsorted(rows, row)
    mine = first + np.searchsorted(
        ends[first : np.searchsorted(rows, row, side="right")], column, side="right"
    )
    chosen = np.flatnonzero(of == of[mine])
    rows, starts, ends = rows[chosen], starts[chosen], ends[chosen]
    for each, begin, stop in zip(rows.tolist(), starts.tolist(), ends.tolist(), strict=True):
        image[each, begin:stop] = label
    return int(rows[0]), int(starts.min()), int(rows[-1]) + 1, int(ends.max())


def _runs(image: LabelImage, label: int) -> tuple[_Integers, _Integers, _Integers]:
    """Return the runs of a label, row by row: first columns, columns after the last, rows."""
    height, width = image.shape
    found = []
    # A column of other labels on either side, so that each run begins and ends.
    inside = np.zeros((min(_ROWS, height), width + 2), dtype=np.bool_)
    changes = np.empty((len(inside), width + 1), dtype=np.bool_)
    for top in range(0, height, _ROWS):
        count = min(_ROWS, height - top)
        np.equal(image[top : top + count], label, out=inside[:count, 1:-1])
        np.not_equal(inside[:count, 1:], inside[:count, :-1], out=changes[:count])
        rows, columns = np.divmod(np.flatnonzero(changes[:count]), width + 1)
        found.append((columns[::2], columns[1::2], rows[::2] + top))
    starts, ends, rows = (np.concatenate(part) for part in zip(*found, strict=True))
    return starts, ends, rows


def _components(starts: _Integers, ends: _Integers, rows: _Integers, *, touch: int) -> _Integers:
    """Return a number for each run, equal where runs are connected; `touch` 1: also by corners."""
    stride = int(ends.max()) + 2  # so that no run reaches into the next row
    begin, stop = rows * stride + starts, rows * stride + ends
    first = np.searchsorted(stop, begin + stride - touch, side="right")
    last = np.searchsorted(begin, stop + stride + touch, side="left")
    counts = np.maximum(last - first, 0)
    above = np.repeat(np.arange(len(starts)), counts)
    below = np.arange(len(above)) + np.repeat(first - (np.cumsum(counts) - counts), counts)
    return _roots(len(starts), above, below)


def _roots(count: int, above: _Integers, below: _Integers) -> _Integers:
    """Return the least run that each run is connected with, by the pairs that touch.

    Each round hangs every tree of runs that touches another one onto one of less number, so that there are at
    most half as many trees of those after it.
    """
    root = np.arange(count)
    while True:
        one, other = root[above], root[below]
        apart = one != other
        if not apart.any():
            return root
        above, below, one, other = above[apart], below[apart], one[apart], other[apart]
        np.minimum.at(root, np.maximum(one, other), np.minimum(one, other))
        while ((higher := root[root]) != root).any():
            root = higher


def pick(layers: Iterable[tuple[str, LabelImage]], row: int, column: int) -> tuple[str, int] | None:
    """Return the layer and the label of the paint that is seen at a pixel.

    Parameters
    ----------
    layers
        Names and images, the topmost first.
    row, column
        The pixel; it may lie outside of the images.
    """
    for name, image in layers:
        if 0 <= row < image.shape[0] and 0 <= column < image.shape[1] and image[row, column]:
            return name, int(image[row, column])
    return None


Dab = tuple[float, float, float]
"""Where a disc's centre is (px right, px down; centres of pixels at +0.5) and its radius (px)."""

_GRID = 1024.0
_TOUCH = 1e-9
"""px beyond a straight edge at which a pixel's centre still counts as on it, whatever was rounded."""


def snap(value: float) -> float:
    """Return a coordinate at the nearest 1/1024 px.

    Squares of such numbers are exact, so that whether a pixel is covered does not hang on rounding, and a
    mirrored stroke is the stroke mirrored.
    """
    return round(value * _GRID) / _GRID


def paint_sweep(image: LabelImage, start: Dab, end: Dab, label: int) -> Box | None:
    """Paint what a disc covers that goes straight from `start` to `end`, its radius changing evenly.

    One disc that stands still always paints the pixel that its centre is in.

    Parameters
    ----------
    image : (height, width) uint8
        Painted into.
    start, end
        The same twice: one disc.
    label
        0 … 255.

    Returns
    -------
    Box or None
        Around the pixels painted; None if there are none in the image.
    """
    top = math.ceil(min(start[1] - start[2], end[1] - end[2], start[1] - 0.5, end[1] - 0.5) - 0.5)
    bottom = math.floor(max(start[1] + start[2], end[1] + end[2], start[1] + 0.5, end[1] + 0.5) - 0.5) + 1
    top, bottom = max(top, 0), min(bottom, image.shape[0])
    if top >= bottom:
        return None
    left, right = _stroke_runs(start, end, np.arange(top, bottom) + 0.5)
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


def _stroke_runs(
    start: Dab, end: Dab, y: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
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
        inside = (min(ay, by) - _TOUCH <= y) & (y <= max(ay, by) + _TOUCH)
        # An edge along a row joins the two discs, which reach as far there.
        across = ax + (bx - ax) * np.clip((y[inside] - ay) / (by - ay), 0.0, 1.0)
        left[inside] = np.minimum(left[inside], across - _TOUCH)
        right[inside] = np.maximum(right[inside], across + _TOUCH)
    return left, right


def _edges(start: Dab, end: Dab) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return the straight edges of a swept disc, which touch both its ends, but for those along rows."""
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


_SPACING = 2.0  # grains between nodes
_FARTHEST = 0.5  # of that: how far a node is moved to where its neighbours have it


class StrokeSmoother:
    """Turns the places of a pen into fewer nodes of its path.

    A slow pen's places are averaged, and each node is moved a little to the middle of its neighbours: a line
    drawn through whole pixels trembles less than half as much then. A quick pen's places stay where they are,
    but for a pixel of the screen.

    Parameters
    ----------
    grain
        Side (px) of the pixels in which places are told; 0: they are exact, and each is a node.
    """

    def __init__(self, grain: float) -> None:
        self._spacing = _SPACING * grain
        self._seen: list[Dab] = []
        self._nodes: list[Dab] = []
        self._anchor: Dab | None = None

    def to(self, place: Dab) -> Dab | None:
        """Go on to a place; return the next node of the path, if one is known now."""
        if self._anchor is None:
            self._anchor = place
            self._nodes = [place]
            return place
        self._seen.append(place)
        way = math.dist(place[:2], self._anchor[:2])
        if way == 0.0 or way < self._spacing:
            return None
        self._anchor = place
        node = _mean(self._seen)
        self._seen = []
        if not self._spacing:
            return node
        self._nodes = [*self._nodes[-2:], node]
        return self._calmed() if len(self._nodes) == 3 else None

    def finish(self) -> list[Dab]:
        """Return the last nodes; the path ends where the pen is."""
        place = self._seen[-1] if self._seen else self._anchor
        if place is None or not self._spacing:
            return []
        self._nodes = [*self._nodes[-2:], place]
        return [self._calmed(), place] if len(self._nodes) == 3 else [place]

    def _calmed(self) -> Dab:
        """Return the middle one of three nodes, moved."""
        (ax, ay, _), (x, y, radius), (bx, by, _) = self._nodes
        dx, dy = 0.25 * (ax + bx) - 0.5 * x, 0.25 * (ay + by) - 0.5 * y
        share = min(1.0, _FARTHEST * self._spacing / max(math.hypot(dx, dy), 1e-9))
        return snap(x + share * dx), snap(y + share * dy), radius


def _mean(dabs: Sequence[Dab]) -> Dab:
    if len(dabs) == 1:
        return dabs[0]
    x, y, radius = (snap(sum(each) / len(dabs)) for each in zip(*dabs, strict=True))
    return x, y, radius


THINNEST = 0.5
"""Radius (px) of the thinnest brush: a line one pixel wide."""

_SAGITTA = 0.1
"""px that the straight parts of a path may be from its curve."""


class Stroke:
    """A round brush that is drawn over a label image.

    The path is the centripetal Catmull-Rom spline through the pen's places, so that corners do not show
    however few of them are told. A piece of it is known once the pen has gone on beyond it: what is painted
    lags one place behind the pen, and `finish` paints the last piece. On a straight line the same pixels are
    painted however many places are told.

    Parameters
    ----------
    image : (height, width) uint8
        Painted into.
    label
        0 … 255; 0 erases.
    grain
        Side (px) of the pixels in which the pen's places are told, those of a screen for a mouse; 0 if they
        are exact. See `StrokeSmoother`.
    """

    def __init__(self, image: LabelImage, label: int, *, grain: float = 0.0) -> None:
        self._image = image
        self._label = label
        self._hand = StrokeSmoother(grain)
        self._dabs: list[Dab] = []
        self._last: Dab | None = None

    def to(self, x: float, y: float, radius: float) -> Box | None:
        """Go on to a place.

        Parameters
        ----------
        x, y
            px to the right and down, centres of pixels at +0.5; may lie outside of the image.
        radius
            px, changing evenly between places; at least `THINNEST` is taken.

        Returns
        -------
        Box or None
            Around the pixels painted; None if none were.
        """
        self._last = snap(x), snap(y), max(snap(radius), THINNEST)
        begins = not self._dabs
        node = self._hand.to(self._last)
        box = None if node is None else self._add(node)
        return union_box(box, self._sweep([self._last, self._last])) if begins else box

    def finish(self) -> Box | None:
        """Paint up to the last place; return the box around the pixels painted, None if none were."""
        if self._last is None:
            return None
        box = self._sweep([self._last, self._last])
        for node in self._hand.finish():
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
    """Return discs along a piece of the smooth path through discs, its two ends first and last.

    Straight lines between them are within a tenth of a pixel of the curve.

    Parameters
    ----------
    dabs
        Two or more, no two neighbours in one place.
    piece
        The curve from ``dabs[piece]`` to ``dabs[piece + 1]``.
    """
    start, end = dabs[piece], dabs[piece + 1]
    near = np.array(dabs[max(piece - 1, 0) : piece + 3])[:, :2]
    c = cubics(near)[min(piece, 1)]
    way = near[min(piece, 1) + 1] - near[min(piece, 1)]
    # How far the curve bends aside of its chord; along it, it may run unevenly without being crooked.
    bends = (c[:, 2], c[:, 2] + 3.0 * c[:, 3])
    aside = max(abs(way[0] * bend[1] - way[1] * bend[0]) for bend in bends) / math.hypot(*way)
    count = math.ceil(math.sqrt(aside / (4.0 * _SAGITTA)) - 1e-6)
    return [start, *_between(c.tolist(), start[2], end[2], count), end]


def _between(c: list[list[float]], from_radius: float, to_radius: float, count: int) -> Iterator[Dab]:
    for k in range(1, count):
        t = k / count
        x, y = (snap(((d * t + c2) * t + c1) * t + c0) for c0, c1, c2, d in c)
        yield x, y, snap(from_radius + (to_radius - from_radius) * t)


def line_width(sketch: Sketch, layer: str, label: int, brush: float) -> float:
    """Return how wide a line of a label is painted, px.

    Parameters
    ----------
    sketch, layer, label
        A label that has a width, as rivers have, is painted as wide as that, never thinner than a pixel.
    brush
        Radius (px) of the brush, for all others.
    """
    if "width" not in LAYERS[layer].parameters:
        return 2.0 * brush
    width = sketch.properties(layer, label)["width"]
    assert isinstance(width, float)  # noqa: S101 # declared so
    return max(width / sketch.pixel_size, 2.0 * THINNEST)


def line_path(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the smooth curve through points as a polyline, to be shown while points are added.

    Parameters
    ----------
    points
        px to the right and down, centres of pixels at +0.5.
    """
    return [(x, y) for x, y, _ in _path(points, THINNEST)]


def draw_line(
    image: LabelImage, points: Sequence[tuple[float, float]], width: float, label: int
) -> Box | None:
    """Paint the smooth curve through points, with round ends.

    Parameters
    ----------
    image : (height, width) uint8
        Painted into.
    points
        One or more: px to the right and down, centres of pixels at +0.5; they may lie outside of the image.
    width
        px; at least one is taken.
    label
        0 … 255.

    Returns
    -------
    Box or None
        Around the pixels painted; None if none were.
    """
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
