"""A stroke of the brush: a smooth path through the places where the pen was, painted while it goes on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from sketchterrain.features.splines import cubics
from sketchterrain.sketch.box import Box, around
from sketchterrain.sketch.document import LabelImage
from sketchterrain.ui.painting.shapes import Dab, paint_sweep, snapped
from sketchterrain.ui.painting.steady import SteadyHand

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
        are exact. See `SteadyHand`.
    """

    def __init__(self, image: LabelImage, label: int, *, grain: float = 0.0) -> None:
        self._image = image
        self._label = label
        self._hand = SteadyHand(grain)
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
        self._last = snapped(x), snapped(y), max(snapped(radius), THINNEST)
        begins = not self._dabs
        node = self._hand.to(self._last)
        box = None if node is None else self._add(node)
        return around(box, self._sweep([self._last, self._last])) if begins else box

    def finish(self) -> Box | None:
        """Paint up to the last place; return the box around the pixels painted, None if none were."""
        if self._last is None:
            return None
        box = self._sweep([self._last, self._last])
        for node in self._hand.finish():
            box = around(box, self._add(node))
        near = self._dabs[-3:]
        if len(near) > 1:
            box = around(box, self._sweep(smooth_dabs(near, len(near) - 2)))
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
            box = around(box, paint_sweep(self._image, start, end, self._label))
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
        x, y = (snapped(((d * t + c2) * t + c1) * t + c0) for c0, c1, c2, d in c)
        yield x, y, snapped(from_radius + (to_radius - from_radius) * t)
