"""Mip levels of a DEM grid, and coefficients of the cubic splines that interpolate them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Float32Array

PADDING: Final = 3
"""Samples by which levels are extrapolated beyond their rim."""

SETTLED: Final = 20
"""Samples beyond a part of a level that its spline depends on: the response falls by 0.27 a sample."""

FILLED: Final = 16
"""Samples of a void beside known ones that splines are fitted to."""

_SMALL = 29  # samples along a side of the last level: one kernel
_THREADS = min(os.cpu_count() or 1, 8)
_NARROW = 12  # samples along the shorter side below which there is no further level


def level_shapes(shape: tuple[int, int]) -> list[tuple[int, int]]:
    """Return the shapes of a grid and of its mip levels, down to one patch.

    The next level reaches as far: a side of n samples has n // 2 + 1.
    """
    shapes = [shape]
    while max(shapes[-1]) > _SMALL and min(shapes[-1]) >= 2 * _NARROW:
        rows, columns = shapes[-1]
        shapes.append((rows // 2 + 1, columns // 2 + 1))
    return shapes


def padded(samples: Float32Array, axis: int, before: bool = True, after: bool = True) -> Float32Array:
    """Return samples, extrapolated at their ends along an axis."""
    padding = [(PADDING * before, PADDING * after) if each == axis else (0, 0) for each in (0, 1)]
    return np.pad(samples, padding, mode="reflect", reflect_type="odd")


def halved(samples: Float32Array, columns: int) -> Float32Array:
    """Return every second sample, from the second row on, filtered by 1-2-1 in both directions.

    `columns` is the number of them without their padding. Vertices stay put, and voids grow from level to
    level, so that no level has heights where the grid has none.
    """
    rows = 0.25 * samples[:-2:2] + 0.5 * samples[1:-1:2] + 0.25 * samples[2::2]
    rows = rows[:, PADDING - 1 : 2 * (columns // 2 + 1) + PADDING]
    filtered = 0.25 * rows[:, :-2:2] + 0.5 * rows[:, 1:-1:2] + 0.25 * rows[:, 2::2]
    return np.ascontiguousarray(filtered, np.float32)


def without_voids(samples: Float32Array) -> Float32Array:
    """Return samples with the nearest one in place of voids."""
    void = np.isnan(samples)
    if not void.any():
        return samples
    near = ndimage.distance_transform_edt(void, return_distances=False, return_indices=True)
    return np.asarray(samples[tuple(near)])


def spline_coefficients(samples: Float32Array, base: float, core: tuple[slice, slice]) -> Float32Array:
    """Return coefficients of the cubic spline that interpolates samples, above `base` (m), in their core."""
    heights = samples.astype(np.float64) - base
    for axis in (1, 0):
        heights = _filled(heights, axis)
    heights = heights[core[0], core[1]]
    heights[np.isnan(heights)] = 0.0
    return np.asarray(ndimage.spline_filter(heights, 3, output=np.float64, mode="mirror"), np.float32)


def _filled(heights: np.ndarray, axis: int) -> np.ndarray:
    """Return heights with the nearest one along an axis in place of NaN, as far as `FILLED`."""
    known = ~np.isnan(heights)
    if known.all():
        return heights
    size, shape = heights.shape[axis], [1, 1]
    shape[axis] = size
    at = np.arange(size).reshape(shape)
    before = np.maximum.accumulate(np.where(known, at, -size), axis)
    after = np.flip(np.minimum.accumulate(np.flip(np.where(known, at, 2 * size), axis), axis), axis)
    near = np.where(at - before <= after - at, before, after)
    values = np.take_along_axis(heights, np.clip(near, 0, size - 1), axis)
    return np.where(np.abs(near - at) <= FILLED, values, np.nan)


def in_threads(work: Callable[[int, int], object], count: int, least: int = 1) -> None:
    """Call compiled work for parts (first, last) of a range, on all processors."""
    parts = max(min(_THREADS, count // least), 1)
    ends = [count * each // parts for each in range(parts + 1)]
    if parts == 1:
        work(0, count)
        return
    with ThreadPoolExecutor(parts, thread_name_prefix="elevation") as pool:
        list(pool.map(work, ends[:-1], ends[1:]))
