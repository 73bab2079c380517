"""Discs for what the darts leave bare of a shape, until as much of it is covered as is asked for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array, Int64Array
    from sketchterrain.features.shape_pixels import Pixels
    from sketchterrain.features.shapes import Shape

_ROUNDS = 8  # of looking for holes
_LEAST_HOLE = 0.9  # px; what is narrower is the raggedness of a brush, which fidelity 1 keeps


def fill_holes(shape: Shape, pixels: Pixels, chosen: Int64Array, fidelity: float) -> Int64Array:
    """Choose discs for what the chosen ones leave bare, the deepest holes first, until enough is covered."""
    cover = _Cover(shape, pixels)
    for index in chosen:
        cover.add(int(index))
    bare_at_most = (1.0 - (0.6 + 0.395 * fidelity**2)) * shape.area
    narrow = _LEAST_HOLE - (_LEAST_HOLE - 0.5) * fidelity**8
    least = max(narrow, 0.35 * math.sqrt(1.0 - fidelity) * float(pixels.disc.max()))
    accepted: list[int] = []
    for _ in range(_ROUNDS):
        if cover.bare <= bare_at_most:
            break
        holes, depths = cover.holes(least)
        for hole, depth in zip(holes.tolist(), depths.tolist(), strict=True):
            if cover.bare <= bare_at_most:
                break
            if not cover.covered[hole]:
                accepted.append(cover.patch(hole, depth))
        if len(holes) == 0:
            break
    return np.asarray(accepted, dtype=np.int64)


class _Cover:
    """Which of a shape's pixels the discs chosen so far cover."""

    def __init__(self, shape: Shape, pixels: Pixels) -> None:
        self._pixels = pixels
        self._number = np.full(shape.mask.shape, -1, dtype=np.int64)
        self._number[pixels.row, pixels.column] = np.arange(shape.area)
        self._largest = float(pixels.disc.max())
        self._chosen = np.zeros(shape.area, dtype=np.bool_)
        self.covered = np.zeros(shape.area, dtype=np.bool_)
        self.bare = shape.area

    def add(self, index: int) -> None:
        """Cover a pixel's disc."""
        near, distance = self._around(index, float(self._pixels.disc[index]) + 0.5)
        newly = near[(distance < self._pixels.disc[index] + 0.5) & ~self.covered[near]]
        self._chosen[index] = True
        self.covered[newly] = True
        self.bare -= len(newly)

    def patch(self, hole: int, depth: float) -> int:
        """Cover a hole that is `depth` deep at a pixel by the largest disc of the shape that can."""
        near, distance = self._around(hole, self._largest)
        able = near[(distance + depth <= self._pixels.disc[near] + 0.5) & ~self._chosen[near]]
        if len(able) == 0:
            able = np.array([hole])
        # Steps of a quarter pixel: among discs of about one size the hash decides, not the reading order.
        size = np.round(4.0 * self._pixels.disc[able])
        best = able[size == size.max()]
        index = int(best[np.argmin(self._pixels.priority[best])])
        self.add(index)
        if not self.covered[hole]:
            self.covered[hole] = True
            self.bare -= 1
        return index

    def holes(self, least: float) -> tuple[Int64Array, Float64Array]:
        """Find the deepest pixels of what is bare and how deep they are (px), deepest first."""
        pixels = self._pixels
        bare = np.zeros(self._number.shape, dtype=np.bool_)
        bare[pixels.row, pixels.column] = ~self.covered
        depth = ndimage.distance_transform_edt(np.pad(bare, 1))[1:-1, 1:-1] - 0.5
        peak = bare & (depth >= least) & (depth == ndimage.maximum_filter(depth, size=3))
        found = self._number[peak]
        order = np.lexsort((pixels.priority[found], -np.round(4.0 * depth[peak])))
        return found[order], depth[peak][order]

    def _around(self, index: int, radius: float) -> tuple[Int64Array, Float64Array]:
        """Pixels of the shape in a window around one, and how far they are from it."""
        row, column = int(self._pixels.row[index]), int(self._pixels.column[index])
        reach = math.ceil(radius)
        rows, columns = (slice(max(at - reach, 0), at + reach + 1) for at in (row, column))
        window = self._number[rows, columns]
        near = window[window >= 0]
        return near, np.hypot(self._pixels.row[near] - row, self._pixels.column[near] - column)
