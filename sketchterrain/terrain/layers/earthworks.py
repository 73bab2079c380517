"""Earthworks of roads and pads in NumPy float64: see ``kernels/layers/earthworks.clh``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.io.resources import kernel_constants
from sketchterrain.terrain.layers.layer import HostSamples

_NEAR, _FAR, _NO_BOUND, _COVERAGE_MOST = kernel_constants(
    "layers/earthworks.clh", "NEAR_STRIP", "FAR_STRIP", "NO_BOUND", "COVERAGE_MOST"
)
STEEPER: Final = 1e-6
"""Least share of a slope's run that is left towards its end."""


@dataclass(frozen=True, eq=False)
class Strips:
    """Nearest points of strips, each with the point of the ground that it is near to."""

    point: Int64Array  # (k,) ascending
    height: Float64Array  # m
    beyond: Float64Array  # m from the edge
    width: Float64Array  # m of the earthworks
    cut: Float64Array
    fill: Float64Array
    away: Float64Array  # (distance from the axis / half width)²
    share: Float64Array
    seen: Float64Array
    shown: BoolArray  # whether it shapes the ground, and is not only a material
    clear: Float64Array  # 0 … 1: without trees
    covered: Float64Array  # share of the cell


def with_strips(ground: HostSamples, strips: Strips) -> HostSamples:
    """Return the ground with the earthworks of strips."""
    point, shown = strips.point[strips.shown], strips.shown
    z, beyond, width, cut, fill, away, share, seen = (
        getattr(strips, name)[shown]
        for name in ("height", "beyond", "width", "cut", "fill", "away", "share", "seen")
    )
    below = ground.height[point]
    part2 = (beyond / width) ** 2
    run = beyond / np.maximum(1.0 - part2**4, STEEPER)
    low, high = z - fill * run, z + cut * run
    low -= (1.0 - seen) * np.maximum(low - below, 0.0)
    high += (1.0 - seen) * np.maximum(below - high, 0.0)
    own = share * np.maximum(1.0 - part2, 0.0) ** 2 / (np.minimum(away, _FAR) + _NEAR) ** 16
    count = len(ground.height)
    most, least = np.full(count, -_NO_BOUND), np.full(count, _NO_BOUND)
    weight, total, clear, covered = np.zeros((4, count))
    np.maximum.at(most, point, low)
    np.minimum.at(least, point, high)
    np.add.at(weight, point, own)
    np.add.at(total, point, own * np.clip(below, low, high))
    np.maximum.at(clear, strips.point, strips.clear)
    np.maximum.at(covered, strips.point, strips.covered)
    contrary = (most > least) & (weight > 0.0)
    mean = np.where(contrary, total / np.where(contrary, weight, 1.0), ground.height)
    height = np.clip(mean, np.minimum(most, least), np.maximum(most, least))
    return replace(
        ground, height=height, forest=ground.forest * (1.0 - clear), water=ground.water * (1.0 - covered)
    )


def coverage(half_width: Float64Array, away: Float64Array, cell: float) -> Float64Array:
    """Return the share of a cell that a carriageway covers."""
    edge = (half_width - away) / cell + 0.5
    return np.asarray(np.clip(np.minimum(edge, 2.0 * half_width / cell), 0.0, _COVERAGE_MOST))
