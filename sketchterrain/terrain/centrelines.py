"""River centrelines as few straight pieces, and how far their valleys reach."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features import River

__all__ = ["simplified", "valley_reach"]

# Straight pieces stay within this share of the width of the curve, and of the depth of its surface.
_TOLERANCE = 0.01
_SMALLEST_TOLERANCE = 0.02  # m
_BED_TOLERANCE = 0.004  # m
# A river is steep where it falls by this share of its depth over its width, and so many widths around.
_STEEP_DEPTHS = 0.2
_STEEP_WIDTHS = 3.0
_FLOODPLAIN_WIDTHS = 4.0
_LEAST_WIDTHS = 3.0  # whatever the largest reach
_SMALLEST_REACH = 30.0  # m
_VALLEY_RUN_PER_DEPTH = 1.7  # about 30° for the steepest part of a valley's side
_LARGEST_REACH = 900.0  # m


def valley_reach(river: River, ground: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return how far a river shapes the ground on each side, at each point of its centreline.

    Parameters
    ----------
    river
    ground
        Height of the ground without rivers along the centreline, shape (m,), m. The deeper the river lies
        below it, the wider the valley.

    Returns
    -------
    ndarray of float64, shape (m,)
        Metres.
    """
    cut = np.maximum(ground - river.centreline[:, 2], 0)
    width = river.centreline_width.astype(np.float64)
    reach = np.maximum(_FLOODPLAIN_WIDTHS * width, _SMALLEST_REACH) + _VALLEY_RUN_PER_DEPTH * cut
    step = float(np.median(np.hypot(*np.diff(river.centreline[:, :2], axis=0).T)))
    smooth = gaussian_filter1d(reach, sigma=max(float(np.median(reach)) / max(step, 1e-3) / 2, 1.0))
    return np.maximum(np.minimum(smooth, _LARGEST_REACH), _LEAST_WIDTHS * width)


def simplified(
    river: River, reach: npt.NDArray[np.float64], meeting: npt.NDArray[np.float64] | None = None
) -> npt.NDArray[np.float64]:
    """Return the points of the centreline that straight pieces need (Douglas & Peucker 1973).

    Parameters
    ----------
    river
    reach
        As `valley_reach` returns it.
    meeting
        Positions (m) where rivers end, shape (n, 2): those on this centreline are kept, so that where
        two rivers meet both have one level.

    Returns
    -------
    ndarray of float64, shape (k, 6)
        x, y (m), water surface (m), half width (m), depth (m), reach (m); upstream first.
    """
    line = np.column_stack(
        [river.centreline, river.centreline_width / 2.0, river.centreline_depth.astype(np.float64), reach]
    )
    width, depth = float(river.centreline_width.min()), float(river.centreline_depth.max())
    # Half a width is one in the bed's parabola: off its line it is shallower by depth * (2 off / width)^2.
    tolerance = min(_TOLERANCE * width, 0.5 * width * math.sqrt(_BED_TOLERANCE / depth))
    tolerance = max(tolerance, _SMALLEST_TOLERANCE)
    # Levels must agree where waters meet; the reach only widens a blend.
    weighted = line * np.array([1, 1, 20, 1, 20, 0.02])
    return line[_douglas_peucker(weighted, tolerance, _met(river, meeting)) | _steep(river)]


def _steep(river: River) -> npt.NDArray[np.bool_]:
    """Return where the water falls so much over its width that it must be shared out evenly.

    Ground beside it takes a weighted mean of the levels near; with long pieces on one side and short ones on
    the other it would lie below the water.
    """
    steps = np.hypot(*np.diff(river.centreline[:, :2], axis=0).T)
    fall = -np.diff(river.centreline[:, 2]) * river.centreline_width[1:]
    steep = fall > _STEEP_DEPTHS * river.centreline_depth[1:] * steps
    around = 2 * math.ceil(_STEEP_WIDTHS * float(river.centreline_width.max()) / float(np.median(steps))) + 1
    return np.asarray(maximum_filter1d(np.append(steep, steep[-1:]), around), dtype=np.bool_)


def _met(river: River, meeting: npt.NDArray[np.float64] | None) -> npt.NDArray[np.intp]:
    """Find the indices of the centreline's ends and of its points where another river ends, ascending."""
    line = river.centreline[:, 0] + 1j * river.centreline[:, 1]
    at = np.zeros(len(line), dtype=bool) if meeting is None else np.isin(line, meeting @ np.array([1, 1j]))
    at[[0, -1]] = True
    return np.flatnonzero(at)


def _douglas_peucker(
    line: npt.NDArray[np.float64], tolerance: float, kept: npt.NDArray[np.intp]
) -> npt.NDArray[np.bool_]:
    """Which points to keep so that every other one is within the tolerance of the piece that replaces it."""
    keep = np.zeros(len(line), dtype=bool)
    keep[kept] = True
    ranges = list(itertools.pairwise(kept.tolist()))
    while ranges:
        first, last = ranges.pop()
        if last - first < 2:
            continue
        chord = line[last] - line[first]
        inner = line[first + 1 : last] - line[first]
        t = np.clip(np.sum(inner * chord, axis=1) / max(float(np.sum(chord**2)), 1e-12), 0, 1)
        distance = np.sqrt(np.sum((inner - t[:, None] * chord) ** 2, axis=1))
        worst = int(np.argmax(distance))
        if distance[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            ranges += [(first, middle), (middle, last)]
    return keep
