"""Darts thrown at a shape (Zaaijer 2013 §4.2): where its summits stand, and discs along its medial axis."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.features.shape_pixels import LEAST_DISC, Pixels

if TYPE_CHECKING:
    from sketchterrain.features.shapes import Shape

_DARTS_EACH = 64  # darts thrown for each summit asked for, before giving up
_ROUNDS = 8  # of darts, closer each time
_AXIS_SLOPE = 0.7  # of the distance map, below which a pixel is on the medial axis
_SPINE_SPACING = 0.5  # of a disc's radius, between discs along the medial axis at fidelity 1
_LEAST_SPINE = 0.3  # of the largest summit's disc: thinner twigs of the axis are a brush's raggedness


def throw_summits(shape: Shape, pixels: Pixels, mean: float, multitude: int) -> Int64Array:
    """Throw darts in order of priority: far apart first, then closer until there are enough."""
    depth, deepest = pixels.depth, float(pixels.depth.max())
    highest = ndimage.maximum_filter(shape.depth, size=3, mode="constant")
    peak = (shape.depth == highest)[pixels.row, pixels.column]
    usable = (peak & (depth >= 0.75 * min(mean, deepest))) | (depth >= min(mean, 0.9 * deepest))
    darts = np.flatnonzero(usable)
    most = _DARTS_EACH * (multitude + 4)
    if len(darts) > most:
        darts = darts[np.argpartition(pixels.priority[darts], most)[:most]]
    darts = darts[np.argsort(pixels.priority[darts], kind="stable")]

    # In a thin shape summits stand along a line, so that its length, not its area, spaces them.
    spacing = max(1.7 * mean, 0.6 * shape.area / (2.0 * max(deepest, 0.5) * multitude))
    # As many discs of the mean size have the shape's area; specks have no room for that many.
    wanted = min(multitude, math.ceil(shape.area / (math.pi * LEAST_DISC**2)))
    accepted: list[int] = []
    for _ in range(_ROUNDS):
        free = np.ones(len(darts), dtype=np.bool_)
        for index in accepted:
            free &= _apart(pixels, darts, index, spacing)
        while free.any() and len(accepted) < wanted:
            index = int(darts[np.argmax(free)])
            accepted.append(index)
            free &= _apart(pixels, darts, index, spacing)
        if len(accepted) >= wanted:
            break
        spacing *= 0.75
    return np.asarray(accepted, dtype=np.int64)


def _apart(pixels: Pixels, darts: Int64Array, index: int, spacing: float | Float64Array) -> BoolArray:
    down = pixels.row[darts] - pixels.row[index]
    across = pixels.column[darts] - pixels.column[index]
    return np.asarray(down * down + across * across >= np.maximum(np.square(spacing), 1.0))


def throw_spine(shape: Shape, pixels: Pixels, summits: Int64Array, fidelity: float) -> Int64Array:
    """Throw darts at the medial axis, so near to each other that the discs overlap."""
    # A distance map climbs by one a pixel but on the medial axis, where it turns.
    down, across = np.gradient(np.pad(shape.depth, 1))
    slope2 = np.asarray(down * down + across * across)[1:-1, 1:-1]
    turning = slope2 < _AXIS_SLOPE**2
    darts = np.flatnonzero(turning[pixels.row, pixels.column])
    darts = darts[np.argsort(pixels.priority[darts], kind="stable")]
    spacing = (_SPINE_SPACING + (1.0 - fidelity)) * pixels.disc[darts]
    free = pixels.disc[darts] > _LEAST_SPINE * pixels.disc[summits].max()
    near = _Near(shape, pixels, darts, np.maximum(spacing, 1.0))
    for index in summits:
        near.clear(free, int(index))
    accepted: list[int] = []
    for turn, index in enumerate(darts.tolist()):
        if free[turn]:
            accepted.append(index)
            near.clear(free, index)
    return np.asarray(accepted, dtype=np.int64)


class _Near:
    """Darts by where they stand, so that one that lands need not be compared with all of them."""

    def __init__(self, shape: Shape, pixels: Pixels, darts: Int64Array, spacing: Float64Array) -> None:
        self._pixels, self._darts, self._spacing = pixels, darts, spacing
        self._reach = math.ceil(float(spacing.max(initial=0.0)))
        self._turn: Int64Array | None = None
        if len(darts) > (2 * self._reach + 1) ** 2:
            self._turn = np.full(shape.mask.shape, -1, dtype=np.int64)
            self._turn[pixels.row[darts], pixels.column[darts]] = np.arange(len(darts))

    def clear(self, free: BoolArray, index: int) -> None:
        """Strike out the darts that are too near to a pixel."""
        if self._turn is None:
            free &= _apart(self._pixels, self._darts, index, self._spacing)
            return
        row, column = int(self._pixels.row[index]), int(self._pixels.column[index])
        rows, columns = (slice(max(at - self._reach, 0), at + self._reach + 1) for at in (row, column))
        window = self._turn[rows, columns]
        near = window[window >= 0]
        free[near] &= _apart(self._pixels, self._darts[near], index, self._spacing[near])
