"""What differs between the fills of two sketches, found without looking at the whole world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Bounds, Float64Array, StructuredArray
from sketchterrain.features.catalogue import FEATURE, FEATURE_TYPES
from sketchterrain.features.edits import EditedFill

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sketchterrain.features.fill import Fill
    from sketchterrain.sketch import Sketch


_OVERLAP = 0.5  # of the smaller rectangle, beyond what joining adds
_MOST_REGIONS = 64  # changed regions that are looked at one by one


def fill_difference(
    old: Fill | EditedFill, new: Fill | EditedFill
) -> tuple[StructuredArray, StructuredArray] | None:
    """Find the features that only one of two fills has.

    Returns
    -------
    Those of the old one and those of the new one, arrays of ``FEATURE``; None if they may differ anywhere.
    """
    (old, old_hidden), (new, new_hidden) = _parts(old), _parts(new)
    if old is new:
        return rows_only_in(new_hidden, old_hidden), rows_only_in(old_hidden, new_hidden)
    if old.rules != new.rules:
        return None
    gone, come = [rows_only_in(new_hidden, old_hidden)], [rows_only_in(old_hidden, new_hidden)]
    if new.max_radius > 0:
        for area in _affected(old, new):
            before, after = old.within(*area), new.within(*area)
            gone.append(rows_only_in(before, after))
            come.append(rows_only_in(after, before))
    return np.unique(np.concatenate(gone)), np.unique(np.concatenate(come))


def rows_only_in(one: StructuredArray, other: StructuredArray) -> StructuredArray:
    """Return the rows of one array that the other does not have, bit for bit."""
    there = set(_rows(other))
    found: StructuredArray = one[np.array([row not in there for row in _rows(one)], dtype=np.bool_)]
    return found


def _rows(points: StructuredArray) -> list[bytes]:
    data, size = np.ascontiguousarray(points).tobytes(), points.dtype.itemsize
    return [data[start : start + size] for start in range(0, len(data), size)]


def _parts(fill: Fill | EditedFill) -> tuple[Fill, StructuredArray]:
    return (fill.fill, fill.replaced) if isinstance(fill, EditedFill) else (fill, np.zeros(0, dtype=FEATURE))


def _affected(old: Fill, new: Fill) -> list[Bounds]:
    """Rectangles outside of which the two fills are the same."""
    found = []
    points = np.concatenate([rows_only_in(old.painted, new.painted), rows_only_in(new.painted, old.painted)])
    for x, y, code, radius in zip(*(points[key] for key in ("x", "y", "type", "radius")), strict=True):
        reaches = new.influence_radii(FEATURE_TYPES[code], float(radius)).values()
        found += [_widened((float(x), float(y), float(x), float(y)), reach) for reach in sorted(reaches)[-1:]]
    for name in new.sketch.layers:
        reaches = new.influence_radii(name).values()
        for reach in sorted(reaches)[-1:]:
            found += [_widened(box, reach) for box in _repainted(old.sketch, new.sketch, name)]
    return merge_boxes(found)


def _widened(box: Bounds, reach: float) -> Bounds:
    west, south, east, north = box
    return west - reach, south - reach, east + reach, north + reach


def _repainted(old: Sketch, new: Sketch, name: str) -> list[Bounds]:
    """Return rectangles (m) around the pixels of a layer painted in only one of two sketches of one size."""
    image, boxes = new.layers[name], []
    if image is old.layers[name]:
        return []
    changed = (image > 0) != (old.layers[name] > 0)
    lines = [np.flatnonzero(changed.any(axis=axis)) for axis in (1, 0)]
    if not len(lines[0]):
        return []
    top, left = (int(each[0]) for each in lines)
    changed = changed[top : lines[0][-1] + 1, left : lines[1][-1] + 1]
    regions, count = ndimage.label(changed, structure=np.ones((3, 3)))
    if count > _MOST_REGIONS:
        regions = changed.astype(np.int32)
    for rows, columns in filter(None, ndimage.find_objects(regions)):
        south, north = (new.height_px - top - row for row in (rows.stop, rows.start))
        pixels = np.array([left + columns.start, south, left + columns.stop, north]) * new.pixel_size
        boxes.append((float(pixels[0]), float(pixels[1]), float(pixels[2]), float(pixels[3])))
    return boxes


def merge_boxes(boxes: Iterable[Bounds]) -> list[Bounds]:
    """Join rectangles that overlap so much that one around both takes in little else."""
    every = np.array(list(boxes), dtype=np.float64).reshape(-1, 4)
    kept, count = np.zeros_like(every), 0
    for box in every:
        again = True
        while again and count:
            rows = kept[:count]
            low, high = np.minimum(rows[:, :2], box[:2]), np.maximum(rows[:, 2:], box[2:])
            areas, own = _area(rows[:, :2], rows[:, 2:]), _area(box[None, :2], box[None, 2:])
            growth = (_area(low, high) - areas - own) / np.maximum(np.minimum(areas, own), 1e-9)
            best = int(growth.argmin())
            again = bool(growth[best] <= -_OVERLAP)
            if again:
                box, count = np.concatenate([low[best], high[best]]), count - 1
                kept[best:count] = kept[best + 1 : count + 1]
        kept[count], count = box, count + 1
    return [(west, south, east, north) for west, south, east, north in kept[:count].tolist()]


def _area(low: Float64Array, high: Float64Array) -> Float64Array:
    size = high - low
    return np.asarray(size[:, 0] * size[:, 1])
