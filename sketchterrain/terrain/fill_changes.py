"""Difference between the fills of two sketches, without querying the whole world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from sketchterrain.array_types import Bounds, Float64Array, StructuredArray
from sketchterrain.placement.feature_types import FEATURE, FEATURE_TYPES, SPACING
from sketchterrain.terrain.edits import EditedFill

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sketchterrain.document.sketch import Sketch
    from sketchterrain.placement.fill import Fill

    Change = tuple[float, str, float | None]
    """How far (m) from the change it is felt, type of a placed feature and its radius, or layer and None."""


def fill_influence(fill: Fill, changes: Sequence[Change], *, support: float) -> float:
    """Return how far (m) from the sketch's changes the terrain of the fill may change.

    Each change is (distance, name, radius): the distance (m) within which a placed feature (its type and
    radius, m) or the pixels of a layer (name and None) may differ. `support` is a feature's reach in radii.
    """
    candidate_influence = [
        (start, way) for start, name, radius in changes for way in fill.influence_radii(name, radius).values()
    ]
    if not candidate_influence:
        return 0.0
    wide, (east, north) = max(start + way for start, way in candidate_influence), fill.sketch.size
    around = (-wide, -wide, east + wide, north + wide)
    candidates = {name: fill.candidates(name, around) for name in fill.types}
    pairs = {
        (rival, own): _pairs(candidates[rival], candidates[own], factor)
        for (rival, own), factor in SPACING.items()
        if rival in candidates and own in candidates
    }
    far = [0.0]
    for start, name, radius in changes:
        felt: dict[str, Float64Array] = {}
        for own, points in candidates.items():
            way = fill.candidate_influence(own, name, points["radius"].astype(np.float64), radius)
            if way is not None:
                felt[own] = np.where(_outside(points, (east, north)) <= start + way, start + way, -np.inf)
                far.append(float((felt[own] + support * points["radius"]).max(initial=0.0)))
        for (rival, own), (i, j, apart) in pairs.items():
            if rival in felt:
                reach = felt[rival][i] + apart + support * candidates[own]["radius"][j]
                far.append(float(reach.max(initial=0.0)))
    return max(far)


def _pairs(
    rivals: StructuredArray, own: StructuredArray, factor: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Float64Array]:
    """Return pairs of conflicting candidates and their distances (m)."""
    reach = factor * float(rivals["radius"].max(initial=0.0) + own["radius"].max(initial=0.0))
    trees = [cKDTree(np.stack([points["x"], points["y"]], axis=-1)) for points in (rivals, own)]
    found = trees[0].sparse_distance_matrix(trees[1], reach * 1.001 + 0.01, output_type="ndarray")
    radii = rivals["radius"][found["i"]].astype(np.float64) + own["radius"][found["j"]]
    itself = (found["i"] == found["j"]) & (rivals is own)
    found = found[(found["v"] <= factor * radii * 1.001 + 0.01) & ~itself]
    return found["i"], found["j"], found["v"]


def _outside(points: StructuredArray, size: tuple[float, float]) -> Float64Array:
    """Return the distance (m) from the sketch; 0 inside."""
    across = np.maximum(np.maximum(-points["x"], points["x"] - size[0]), 0.0)
    along = np.maximum(np.maximum(-points["y"], points["y"] - size[1]), 0.0)
    return np.asarray(np.hypot(across, along))


_OVERLAP = 0.5  # of the smaller rectangle, beyond what joining adds
_MOST_REGIONS = 64  # changed regions that are looked at one by one


def fill_difference(
    old: Fill | EditedFill, new: Fill | EditedFill
) -> tuple[StructuredArray, StructuredArray] | None:
    """Return the features that only the old and only the new fill has; None if they may differ anywhere."""
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
    """Return rectangles outside of which the two fills are the same."""
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
    """Return rectangles (m) around pixels of a layer painted in only one of two sketches of one size."""
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
    """Merge rectangles whose common bounding box adds little area."""
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
