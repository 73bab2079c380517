"""Waters that a DEM has as level areas: flattened lakes, and reaches of stepped rivers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import contourpy
import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array, Int32Array
from sketchterrain.elevation.grids import ElevationGrid

MIN_SAMPLES: Final = 64
"""Fewest samples of a level area."""

_BANKS = 0.9  # share of the samples around that are higher; the others are outlets
_ELONGATED = 12.0  # area by that of its largest circle, from which on a water is a reach of a river
_NEAR = 3  # samples between reaches of one river
_BLOCK = np.ones((3, 3), bool)


class FlatWater(NamedTuple):
    """A level area in higher ground."""

    level: float  # m
    rings: tuple[Float64Array, ...]  # (n, 2), m: border, then islands; the first vertex is not repeated
    area: float  # m²
    is_river: bool  # elongated
    step: float  # m: the least from another reach beside it; NaN without one


class _WaterLevel(NamedTuple):
    height: float
    box: tuple[slice, slice]  # around the region
    region: BoolArray


def flat_waters(grid: ElevationGrid, least: int = MIN_SAMPLES) -> list[FlatWater]:
    """Return level areas of at least some samples, and at least 3 wide, which higher ground surrounds.

    A level area at 0 m that reaches the grid's rim is the sea, and is not returned.
    """
    heights = np.nan_to_num(grid.samples, nan=np.inf)
    level = ndimage.maximum_filter(heights, 3) == ndimage.minimum_filter(heights, 3)
    labels, _ = ndimage.label(level & np.isfinite(heights), _BLOCK)
    marks = np.zeros([n + 2 * _NEAR for n in labels.shape], np.int32)  # of the waters found
    found: list[_WaterLevel] = []
    for label, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        start = max(rows.start - 2, 0), max(columns.start - 2, 0)
        box = slice(start[0], rows.stop + 2), slice(start[1], columns.stop + 2)
        region = ndimage.binary_dilation(labels[box] == label, _BLOCK)
        if np.count_nonzero(region) < least:
            continue
        around = ndimage.binary_dilation(region, _BLOCK) & ~region & np.isfinite(grid.samples[box])
        height = float(heights[box][region][0])
        at_rim = start[0] == 0 or start[1] == 0 or box[0].stop > len(labels) or box[1].stop > labels.shape[1]
        if (at_rim and height == 0.0) or not around.any() or np.mean(heights[box][around] > height) < _BANKS:
            continue
        found.append(_WaterLevel(height, box, region))
        marks[_NEAR:-_NEAR, _NEAR:-_NEAR][box][region] = len(found)
    return [_water(grid, each, found, marks) for each in found]


def water_findings(waters: Sequence[FlatWater]) -> tuple[str, ...]:
    """Return what was found, in words."""
    lakes, reaches = ([each for each in waters if each.is_river is kind] for kind in (False, True))
    told = []
    if lakes:
        area = sum(each.area for each in lakes) / 1e6
        what = "lake" if len(lakes) == 1 else "lakes"
        told.append(f"{len(lakes)} flattened {what} of {area:.3g} km² in all")
    if reaches:
        steps = [each.step for each in reaches if np.isfinite(each.step)]
        text = f", in steps of {min(steps):.3g} to {max(steps):.3g} m" if steps else ""
        told.append(f"{len(reaches)} level reaches of rivers{text}")
    return tuple(told)


def _water(grid: ElevationGrid, water: _WaterLevel, found: list[_WaterLevel], marks: Int32Array) -> FlatWater:
    """Return the outline and facts of a level area; `marks` has the numbers of all, in a margin of zeros."""
    rows, columns = water.box
    padded = np.pad(water.region, 1)
    rings = []
    for line in contourpy.contour_generator(z=padded.astype(np.float64)).lines(0.5):
        column, row = (line[:-1] + np.array([columns.start - 1.0, rows.start - 1.0])).T
        rings.append(np.stack(grid.to_metres(column, row), axis=1))
    areas = []
    for x, y in (ring.T for ring in rings):
        areas.append(0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))))
    order = np.argsort(areas)[::-1]
    widest = float(ndimage.distance_transform_edt(padded).max())
    is_river = np.count_nonzero(padded) > _ELONGATED * np.pi * widest**2
    near = ndimage.binary_dilation(np.pad(water.region, _NEAR), iterations=_NEAR)
    window = marks[rows.start : rows.start + len(near), columns.start : columns.start + near.shape[1]]
    rises = [abs(found[each - 1].height - water.height) for each in np.unique(window[near]) if each]
    step = min((each for each in rises if each), default=np.nan)
    area = 2.0 * max(areas) - sum(areas)
    return FlatWater(water.height, tuple(rings[each] for each in order), area, bool(is_river), step)
