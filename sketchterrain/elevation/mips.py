"""Mip levels of a DEM grid, and coefficients of the cubic splines that interpolate them."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array

_SMALL = 29  # samples along a side of the last level: one kernel
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


def spline_coefficients(samples: Float32Array, before: int, shape: tuple[int, int]) -> Float64Array:
    """Return coefficients of the cubic B-spline that interpolates a level, `before` ones ahead of its first.

    The spline continues straight over the rim. `shape` is that of the result; where it reaches further the
    coefficients at the rim are repeated, which no surface evaluates.
    """
    rim = min(before, *(n - 1 for n in samples.shape))
    padded = np.pad(samples.astype(np.float64), rim, mode="reflect", reflect_type="odd")
    solved: Float64Array = ndimage.spline_filter(padded, 3, output=np.float64, mode="mirror")
    ahead = before - rim
    solved = solved[: shape[0] - ahead, : shape[1] - ahead]
    return np.pad(
        solved, [(ahead, n - ahead - m) for n, m in zip(shape, solved.shape, strict=True)], mode="edge"
    )
