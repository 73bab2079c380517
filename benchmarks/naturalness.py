"""Visibility of painted outlines in the terrain, from slopes and curvatures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array

if TYPE_CHECKING:
    from sketchterrain.terrain.terrain import Terrain


_LAYERS = ("mountain", "hill")
_NEAR = 1.5  # px: half the width of the outline
_BESIDE = (3.0, 9.0)  # px: the bands on both sides to which the outline is compared


@dataclass(frozen=True)
class Naturalness:
    """Ratio of the terrain along painted outlines of mountains and hills to bands 3 to 9 pixels away.

    1 where an outline is invisible; creases or steps make it larger. None without mountains and hills.
    """

    # curvature, slope: Mean along the outlines of mountains and hills over the mean of the bands inside and
    # outside, 3 to 9 pixels away. 1 where an outline does not show; a crease or a step along it makes it
    # larger. None where neither is painted
    curvature: float | None
    slope: float | None


def measure_naturalness(terrain: Terrain) -> Naturalness:
    """Measure the visibility of painted outlines at the sketch's pixels and their resolution."""
    sketch, step = terrain.sketch, terrain.sketch.pixel_size
    painted = [sketch.layers[name] > 0 for name in _LAYERS if sketch.layers[name].any()]
    if not painted:
        return Naturalness(None, None)
    x = (np.arange(-1, sketch.width_px + 1) + 0.5) * step
    y = (sketch.height_px - np.arange(-1, sketch.height_px + 1) - 0.5) * step
    height = terrain.heights(x[None, :], y[:, None], cell_size=step).astype(np.float64)
    curvature, slope = _derivatives(height, step)
    return Naturalness(
        curvature=float(np.mean([outline_ratio(curvature, area) for area in painted])),
        slope=float(np.mean([outline_ratio(slope, area) for area in painted])),
    )


def outline_ratio(quantity: Float64Array, painted: BoolArray) -> float:
    """Return the mean of a quantity (height, width) ≥ 0 along an outline over that of bands beside it."""
    inside = np.asarray(ndimage.distance_transform_edt(painted))
    outside = np.asarray(ndimage.distance_transform_edt(~painted))
    depth = np.maximum(inside, outside)
    along = depth < _NEAR
    beside = (depth > _BESIDE[0]) & (depth < _BESIDE[1])
    bands = [quantity[beside & side] for side in (painted, ~painted)]
    usual = np.mean([band.mean() for band in bands if band.size])
    return float(quantity[along].mean() / max(float(usual), 1e-12))


def _derivatives(height: Float64Array, step: float) -> tuple[Float64Array, Float64Array]:
    """Return |Laplacian| (1/m) and slope of all but the outermost samples."""
    middle = height[1:-1, 1:-1]
    across, down = (height[1:-1, 2:], height[1:-1, :-2]), (height[2:, 1:-1], height[:-2, 1:-1])
    laplacian = (sum(across) + sum(down) - 4.0 * middle) / step**2
    slope = np.hypot(across[0] - across[1], down[0] - down[1]) / (2.0 * step)
    return np.abs(laplacian), slope
