"""Width and water level along a river."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sketchterrain.features.river_path import smoothed

Floats = npt.NDArray[np.float64]

LEAST_FALL = 1e-4
"""Metres that water falls on every metre of its way."""

_SPRING_WIDTH = 0.4  # of the label's width
_CONFLUENCE_GROWTH = (
    0.15  # the first tributary widens a river by this share, each further one by half as much
)


def smoothstep(t: Floats) -> Floats:
    """0 up to 0, 1 from 1 on, smooth between."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def width_along(base: Floats, arc: Floats, taper: float, tributaries: list[tuple[int, float]]) -> Floats:
    """Width of a river along its centreline.

    Parameters
    ----------
    base : (m,) float64
        What its labels say (m).
    arc : (m,) float64
        Length from its spring (m).
    taper : float
        Length (m) over which it grows from 0.4 of its width.
    tributaries : list of (index, width)
        Where on the centreline they join, and how wide they are there (m).
    """
    width = base * (_SPRING_WIDTH + (1.0 - _SPRING_WIDTH) * smoothstep(arc / max(taper, 1e-9)))
    growth = _CONFLUENCE_GROWTH
    for index, joining in sorted(tributaries):
        joined = smoothstep((arc - arc[index]) / (3.0 * max(joining, float(width[index]))))
        wider = np.maximum(width * (1.0 + growth), joining * (1.0 + growth))
        width = width + (wider - width) * joined
        growth *= 0.5
    return width


def surface_along(
    ground: Floats, arc: Floats, *, width: float, depth: float, ceilings: list[tuple[int, float]]
) -> Floats:
    """Water level along a river, from the ground that it runs through: falling all the way.

    Parameters
    ----------
    ground : (m,) float64
        Height of the ground along the centreline (m).
    arc : (m,) float64
        Length from the spring (m).
    width, depth : float
        Of the water (m). The level is smoothed over about 20 widths, and lies 0.3 depths and half a metre
        below the ground.
    ceilings : list of (index, level)
        Levels (m) of tributaries where they join: this river should not be above them.
    """
    spacing = max(float(arc[-1]) / max(len(arc) - 1, 1), 1e-9)
    sigma = min(6.0 * width / spacing, len(arc) / 4.0)
    wanted = _blurred(ground, sigma) - (0.3 * depth + 0.5)
    for index, level in ceilings:
        wanted[index:] = np.minimum(wanted[index:], level)
    falling = np.minimum.accumulate(wanted)
    falling = np.minimum.accumulate(_blurred(falling, 0.5 * sigma))
    return np.asarray(falling - LEAST_FALL * arc)


def joined_to(level: Floats, arc: Floats, *, end: float, width: float) -> Floats:
    """Bend a falling water level so that it ends exactly at `end` and still falls all the way.

    Where it lay lower it is raised; where it would arrive too high it comes down over the last 30 widths.
    """
    left = arc[-1] - arc
    level = np.maximum(level, end + LEAST_FALL * left)
    approach = smoothstep(1.0 - left / max(min(30.0 * width, float(arc[-1])), 1e-9))
    level = level - (level[-1] - end) * approach
    level[-1] = end
    return np.asarray(np.minimum.accumulate(level))


def _blurred(values: Floats, sigma: float) -> Floats:
    return smoothed(values[:, None], max(sigma, 1e-3))[:, 0]
