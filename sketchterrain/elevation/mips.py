"""Mip levels of a DEM grid, and coefficients of the cubic splines that interpolate them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float32Array

_SMALL = 29  # samples along a side of the last level: one kernel
_STRIP, _SETTLED = 256, 24  # rows; the filter's response falls by 0.27 a row
_THREADS = min(os.cpu_count() or 1, 8)
_NARROW = 12  # samples along the shorter side below which there is no further level


def next_level(samples: Float32Array) -> Float32Array:
    """Return every second sample of the grid filtered by 1-2-1 in both directions: vertices stay put.

    Samples beyond the rim are extrapolated, so that the next level reaches as far: a side of n samples has
    n // 2 + 1.
    """
    for axis in (0, 1):
        even = samples.shape[axis] % 2 == 0
        padding = [(1, 1 + even) if each == axis else (0, 0) for each in (0, 1)]
        along = np.moveaxis(np.pad(samples, padding, mode="reflect", reflect_type="odd"), axis, 0)
        samples = np.moveaxis(0.25 * along[:-2:2] + 0.5 * along[1:-1:2] + 0.25 * along[2::2], 0, axis)
    return np.ascontiguousarray(samples, np.float32)


def mip_levels(samples: Float32Array) -> list[Float32Array]:
    """Return the grid without voids and its mip levels, down to one patch."""
    levels = [samples]
    while max(levels[-1].shape) > _SMALL and min(levels[-1].shape) >= 2 * _NARROW:
        levels.append(next_level(levels[-1]))
    return levels


def valid_levels(valid: BoolArray, shapes: list[tuple[int, int]]) -> list[BoolArray]:
    """Return which samples of each level are filtered from valid ones, those beyond the grid's rim included.

    Voids grow from level to level, so that no level has heights where the grid has none.
    """
    levels = [valid]
    for level, shape in enumerate(shapes[1:], start=1):
        wide = ndimage.minimum_filter(levels[-1], 3, mode="nearest") if not valid.all() else levels[-1]
        each = np.ones(shape, bool)
        inside = tuple(slice(((n - 1) >> level) + 1) for n in valid.shape)
        each[inside] = wide[::2, ::2][inside]
        levels.append(each)
    return levels


def without_voids(samples: Float32Array) -> Float32Array:
    """Return the grid with the nearest sample in place of voids: splines need it, surfaces leave it out."""
    void = np.isnan(samples)
    if not void.any():
        return samples
    near = ndimage.distance_transform_edt(void, return_distances=False, return_indices=True)
    return np.asarray(samples[tuple(near)])


def spline_coefficients(
    samples: Float32Array, base: float, before: int, shape: tuple[int, int]
) -> Float32Array:
    """Return coefficients of the cubic B-spline that interpolates a level, above `base` (m).

    `before` of them are ahead of the first sample; the spline continues straight over the rim. `shape` is
    that of the result; where it reaches further the last ones are repeated, which no surface evaluates.
    """
    rim = min(before, *(n - 1 for n in samples.shape))
    padded = np.pad(samples, rim, mode="reflect", reflect_type="odd")
    solved = np.empty(padded.shape, np.float32)

    def solve(first: int, last: int) -> None:
        for start in range(_STRIP * first, min(_STRIP * last, len(padded)), _STRIP):
            low = max(start - _SETTLED, 0)
            strip = padded[low : start + _STRIP + _SETTLED].astype(np.float64) - base
            part = ndimage.spline_filter(strip, 3, output=np.float64, mode="mirror")
            solved[start : start + _STRIP] = part[start - low : start - low + _STRIP]

    in_threads(solve, -(-len(padded) // _STRIP))
    core = solved[: shape[0] - before + rim, : shape[1] - before + rim]
    rest = [(before - rim, n - before + rim - m) for n, m in zip(shape, core.shape, strict=True)]
    return np.pad(core, rest, mode="edge")


def in_threads(work: Callable[[int, int], object], count: int, least: int = 1) -> None:
    """Call compiled work for parts (first, last) of a range, on all processors."""
    parts = max(min(_THREADS, count // least), 1)
    ends = [count * each // parts for each in range(parts + 1)]
    if parts == 1:
        work(0, count)
        return
    with ThreadPoolExecutor(parts, thread_name_prefix="elevation") as pool:
        list(pool.map(work, ends[:-1], ends[1:]))
