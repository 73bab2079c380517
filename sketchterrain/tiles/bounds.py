"""Bounded worlds: which tiles intersect the rectangle that has terrain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.tiles.codes import Boxes, decode

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Bounds, Int64Array


UNBOUNDED: Final = (float("-inf"), float("-inf"), float("inf"), float("inf"))
"""West, south, east, north (m) of a world without end."""


def tile_range(bounds: Bounds, width: float) -> Bounds:
    """Return first and last column, first and last row of the tiles of a width (m) that intersect bounds."""
    west, south, east, north = (np.array(bounds) / width).tolist()
    return float(np.floor(west)), float(np.ceil(east)) - 1, float(np.floor(south)), float(np.ceil(north)) - 1


def intersects_bounds(codes: Int64Array, extent: float, bounds: Bounds) -> npt.NDArray[np.bool_]:
    """Return which tiles share more than a border with the bounds; any shape."""
    if bounds == UNBOUNDED:
        return np.ones(codes.shape, np.bool_)
    level, col, row = decode(codes)
    width = extent * np.exp2(-level.astype(np.float64))
    west, south, east, north = bounds
    inside = (col * width < east) & ((col + 1) * width > west)
    return np.asarray(inside & (row * width < north) & ((row + 1) * width > south))


def clip_boxes(boxes: Boxes, bounds: Bounds) -> Boxes:
    """Return boxes clipped to bounds; boxes outside become flat."""
    if bounds == UNBOUNDED:
        return boxes
    low, high = boxes.low.copy(), boxes.high.copy()
    for corners in (low, high):
        corners[:, :2] = np.clip(corners[:, :2], bounds[:2], bounds[2:])
    return Boxes(low, high)
