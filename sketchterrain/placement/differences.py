"""Differences between sets of features and between label images, as rows and rectangles."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Bounds, Float64Array, StructuredArray

if TYPE_CHECKING:
    from sketchterrain.document.label_layers import LabelImage

_OVERLAP = 0.5  # of the smaller rectangle, required to join two
_MAX_REGIONS = 64  # repainted regions treated separately


def rows_only_in(one: StructuredArray, other: StructuredArray) -> StructuredArray:
    """Return the rows of one array that the other does not have, bit for bit."""
    others_rows = set(_rows(other))
    only: StructuredArray = one[np.array([row not in others_rows for row in _rows(one)], dtype=np.bool_)]
    return only


def _rows(points: StructuredArray) -> list[bytes]:
    data, size = np.ascontiguousarray(points).tobytes(), points.dtype.itemsize
    return [data[start : start + size] for start in range(0, len(data), size)]


def widened(box: Bounds, distance: float) -> Bounds:
    """Return a rectangle with a margin on each side."""
    west, south, east, north = box
    return west - distance, south - distance, east + distance, north + distance


def repainted_boxes(old: LabelImage | None, new: LabelImage | None, pixel_size: float) -> list[Bounds]:
    """Return rectangles (m) around pixels painted in only one of two images of one size (None: empty)."""
    if old is new:
        return []
    masks = [np.zeros((1, 1), np.bool_) if image is None else image > 0 for image in (old, new)]
    changed = masks[0] != masks[1]
    lines = [np.flatnonzero(changed.any(axis=axis)) for axis in (1, 0)]
    if not len(lines[0]):
        return []
    height, boxes = len(changed), []
    top, left = (int(each[0]) for each in lines)
    changed = changed[top : lines[0][-1] + 1, left : lines[1][-1] + 1]
    regions, count = ndimage.label(changed, structure=np.ones((3, 3)))
    if count > _MAX_REGIONS:
        regions = changed.astype(np.int32)
    for rows, columns in filter(None, ndimage.find_objects(regions)):
        south, north = (height - top - row for row in (rows.stop, rows.start))
        pixels = np.array([left + columns.start, south, left + columns.stop, north]) * pixel_size
        boxes.append((float(pixels[0]), float(pixels[1]), float(pixels[2]), float(pixels[3])))
    return boxes


def merge_boxes(boxes: Iterable[Bounds]) -> list[Bounds]:
    """Merge rectangles whose common bounding box adds little area."""
    every = np.array(list(boxes), dtype=np.float64).reshape(-1, 4)
    merged, count = np.zeros_like(every), 0
    for box in every:
        merging = True
        while merging and count:
            rows = merged[:count]
            low, high = np.minimum(rows[:, :2], box[:2]), np.maximum(rows[:, 2:], box[2:])
            areas, own = _areas(rows[:, :2], rows[:, 2:]), _areas(box[None, :2], box[None, 2:])
            growth = (_areas(low, high) - areas - own) / np.maximum(np.minimum(areas, own), 1e-9)
            best = int(growth.argmin())
            merging = bool(growth[best] <= -_OVERLAP)
            if merging:
                box, count = np.concatenate([low[best], high[best]]), count - 1
                merged[best:count] = merged[best + 1 : count + 1]
        merged[count], count = box, count + 1
    return [(west, south, east, north) for west, south, east, north in merged[:count].tolist()]


def _areas(low: Float64Array, high: Float64Array) -> Float64Array:
    size = high - low
    return np.asarray(size[:, 0] * size[:, 1])
