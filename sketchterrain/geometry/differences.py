"""Differences between sets of features and between label images, as rows and rectangles."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import Bounds, Float64Array, Int64Array, StructuredArray, UInt8Array

_OVERLAP = 0.5  # of the smaller rectangle, required to join two
_BLOCK = 4096  # rows compared at once
_NONE = np.zeros(0, np.int64)
_MAX_REGIONS = 64  # repainted regions treated separately


def row_difference(old: StructuredArray, new: StructuredArray) -> tuple[Int64Array, Int64Array]:
    """Return the indices of rows that only the old and only the new array has, bit for bit.

    Both are sorted by unique ids. Blocks are compared as memory: k changes among n rows cost one pass over
    the memory and the search of k blocks.
    """
    removed, added = [_NONE], [_NONE]
    one, other = _words(old), _words(new)
    i = j = 0
    while old is not new and i < len(old) and j < len(new):
        rows = min(_BLOCK, len(old) - i, len(new) - j)
        mine, others = slice(i, i + rows), slice(j, j + rows)
        if not np.array_equal(one[mine], other[others]):
            ids, other_ids = old["id"][mine], new["id"][others]
            last = min(ids[-1], other_ids[-1])
            ids, other_ids = (each[: np.searchsorted(each, last, "right")] for each in (ids, other_ids))
            _, at, there = np.intersect1d(ids, other_ids, assume_unique=True, return_indices=True)
            same = (one[i + at] == other[j + there]).all(axis=1)
            removed.append(np.delete(np.arange(i, i + len(ids)), at[same]))
            added.append(np.delete(np.arange(j, j + len(other_ids)), there[same]))
            i, j = i + len(ids), j + len(other_ids)
        else:
            i, j = i + rows, j + rows
    if old is not new:
        removed.append(np.arange(i, len(old)))
        added.append(np.arange(j, len(new)))
    return np.concatenate(removed), np.concatenate(added)


def rows_only_in(one: StructuredArray, other: StructuredArray) -> StructuredArray:
    """Return the rows of one array that the other does not have, bit for bit; both sorted by unique ids."""
    only: StructuredArray = one[row_difference(one, other)[0]]
    return only


def _words(rows: StructuredArray) -> npt.NDArray[np.unsignedinteger]:
    """Return rows as words, (rows, words)."""
    size = math.gcd(rows.dtype.itemsize, 8)
    return np.ascontiguousarray(rows).view(f"u{size}").reshape(len(rows), rows.dtype.itemsize // size)


def widened(box: Bounds, distance: float) -> Bounds:
    """Return a rectangle with a margin on each side."""
    west, south, east, north = box
    return west - distance, south - distance, east + distance, north + distance


def repainted_boxes(old: UInt8Array | None, new: UInt8Array | None, pixel_size: float) -> list[Bounds]:
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
    """Merge rectangles whose common bounding box adds little area; those inside others are left out."""
    left = np.array(list(dict.fromkeys(boxes)), dtype=np.float64).reshape(-1, 4)
    left = left[np.argsort(-_areas(left[:, :2], left[:, 2:]), kind="stable")]
    merged, count = np.zeros_like(left), 0
    while len(left):
        box, left, merging, grown = left[0], left[1:], True, False
        while merging and count:
            rows = merged[:count]
            low, high = np.minimum(rows[:, :2], box[:2]), np.maximum(rows[:, 2:], box[2:])
            areas, own = _areas(rows[:, :2], rows[:, 2:]), _areas(box[None, :2], box[None, 2:])
            growth = (_areas(low, high) - areas - own) / np.maximum(np.minimum(areas, own), 1e-9)
            best = int(growth.argmin())
            merging = bool(growth[best] <= -_OVERLAP)
            if merging:
                box, count, grown = np.concatenate([low[best], high[best]]), count - 1, True
                merged[best:count] = merged[best + 1 : count + 1]
        merged[count], count = box, count + 1
        if grown:
            left = left[((left[:, :2] < box[:2]) | (left[:, 2:] > box[2:])).any(axis=1)]
    return [(west, south, east, north) for west, south, east, north in merged[:count].tolist()]


def _areas(low: Float64Array, high: Float64Array) -> Float64Array:
    size = high - low
    return np.asarray(size[:, 0] * size[:, 1])
