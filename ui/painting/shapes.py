"""Discs, and discs swept along a line while their radius changes, as rows of whole pixels.

A pixel is covered when its centre is inside, its edge included. What is swept is convex, so each row of it is
one run of pixels: a shape costs its rows and its pixels, not the box around it.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from sketchterrain.sketch.box import Box
from sketchterrain.sketch.document import LabelImage

Dab = tuple[float, float, float]
"""Where a disc's centre is (px right, px down; centres of pixels at +0.5) and its radius (px)."""

_GRID = 1024.0
_TOUCH = 1e-9
"""px beyond a straight edge at which a pixel's centre still counts as on it, whatever was rounded."""


def snapped(value: float) -> float:
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
    left, right = _runs(start, end, np.arange(top, bottom) + 0.5)
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


def _runs(
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
