"""Width and water level along a river."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.features.river_path import smoothed
from sketchterrain.features.rounding import rounded

LEAST_FALL = 1e-4
"""Metres that water falls on every metre of its way."""

_STEEPEST, _LEAST_STEEPEST, _STEEPEST_DEPTHS = 0.6, 0.03, 1.2
_SPRING_WIDTH = 0.4  # of the label's width
_BEND_ROUNDS = 60
_WIDEST = 2.0  # times what the label says: confluences widen a river no further


def smoothstep(t: Float64Array) -> Float64Array:
    """0 up to 0, 1 from 1 on, smooth between."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def river_widths(
    base: Float64Array, arc: Float64Array, taper: float, tributaries: list[tuple[int, float]]
) -> Float64Array:
    """Width of a river along its centreline.

    At a confluence the squares of the widths add up, as drained areas do (Leopold & Maddock 1953: width goes
    with the root of the discharge), up to twice what the label says.

    Parameters
    ----------
    base : (m,) float64
        What its labels say (m).
    arc : (m,) float64
        Length from its spring (m).
    taper : float
        Length (m) over which it grows from 0.4 of its width; 0 for a river that has its width from the start.
    tributaries : list of (index, width)
        Where on the centreline they join, and how wide they are there (m).
    """
    grown = smoothstep(arc / taper) if taper > 0.0 else np.ones(len(arc))
    width = base * (_SPRING_WIDTH + (1.0 - _SPRING_WIDTH) * grown)
    for index, joining in sorted(tributaries):
        joined = smoothstep((arc - arc[index]) / (3.0 * max(joining, float(width[index]))))
        # A tributary wider than its stem is the river from here on.
        wider = np.maximum(np.minimum(np.hypot(width, joining), _WIDEST * base), np.maximum(width, joining))
        width = width + (wider - width) * joined
    return width


def water_surface(
    ground: Float64Array, arc: Float64Array, *, width: float, depth: float, ceilings: list[tuple[int, float]]
) -> Float64Array:
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
    falling = rounded(_blurred(falling, 0.5 * sigma))
    for index, level in ceilings:  # once more: the blur rounds their steps
        falling[index:] = np.minimum(falling[index:], level + LEAST_FALL * arc[index])
    falling = np.minimum.accumulate(falling)
    return np.asarray(falling - LEAST_FALL * arc)


def limit_gradient(
    level: Float64Array, arc: Float64Array, *, width: Float64Array, depth: Float64Array
) -> Float64Array:
    """Cut back falls, in a gorge if need be: the wider and the shallower a river, the less it falls.

    Water falls by at most 1.2 depths over a width, and by at most 0.6 m on every metre of its way: beside a
    wide sheet of water that is steeper no bank can stand.
    """
    steepest = np.clip(_STEEPEST_DEPTHS * depth / width, _LEAST_STEEPEST, _STEEPEST)
    steps = 0.5 * (steepest[1:] + steepest[:-1]) * np.diff(arc)
    most = np.concatenate([[0.0], np.cumsum(steps)])
    limit = np.minimum.accumulate((level + most)[::-1])[::-1] - most
    return np.asarray(np.where(level > limit + 1e-9, limit, level))  # the end stays to the bit


def join_level(level: Float64Array, arc: Float64Array, *, end: float, width: float) -> Float64Array:
    """Bend a falling water level so that it ends exactly at `end` and still falls all the way.

    Where it lay lower it is raised; where it would arrive too high it comes down over the last 30 widths.
    """
    left = arc[-1] - arc
    level = np.maximum(level, end + LEAST_FALL * left)
    approach = smoothstep(1.0 - left / max(min(30.0 * width, float(arc[-1])), 1e-9))
    level = level - (level[-1] - end) * approach
    level[-1] = end
    return np.asarray(np.minimum.accumulate(level))


def level_pool(level: Float64Array, arc: Float64Array, first: float, last: float) -> Float64Array:
    """Make the water from `first` to `last` (m along the river) a pool at the level that it had at its end.

    Upstream of the pool, over four times its length, the river falls as much as before and that much earlier.
    """
    first, last = max(first, 0.0), min(last, float(arc[-1]))
    if not first < last:
        return level
    start = max(first - 4.0 * (last - first), 0.0)
    earlier = last - (first - np.clip(arc, start, first)) * (last - start) / max(first - start, 1e-9)
    moved = np.interp(np.where(arc < first, earlier, last), arc, level)
    pool = float(np.interp(last, arc, level)) + LEAST_FALL * (last - arc)
    inside = (arc >= start) & (arc <= last)
    return np.asarray(np.where(inside, np.minimum(level, np.maximum(moved, pool)), level))


@dataclass(frozen=True, eq=False)
class Bends:
    """Places whose bank belongs to a place further down.

    Attributes
    ----------
    upper : (k,) int
        Points of a centreline.
    lower : (k,) float64
        The place whose bank stands beside each, in points: between two of them, further down.
    off : (k,) float64
        How far the bank stands from that place, in half widths there.
    """

    upper: npt.NDArray[np.intp]
    lower: Float64Array
    off: Float64Array


def lower_in_bends(level: Float64Array, arc: Float64Array, bends: Bends, depth: Float64Array) -> Float64Array:
    """Lower the water above sharp bends, so that it does not stand above its own bank further down.

    Parameters
    ----------
    level, arc : (m,) float64
        Water level and length from the spring (m).
    bends : Bends
    depth : (m,) float64
        Metres; a bank counts as up to a quarter of it high, and less near the water's edge.
    """
    before = np.minimum(bends.lower.astype(np.intp), len(level) - 2)
    share = bends.lower - before
    same = before == bends.upper
    bank = np.minimum(0.25, 0.5 * smoothstep((bends.off - 1.0) / 0.8)) * depth[bends.upper]
    run = np.interp(bends.lower, np.arange(len(arc)), arc) - arc[bends.upper]
    bank = np.maximum(bank, 1.1 * LEAST_FALL * run)  # no lower than the water must fall on its way
    for _ in range(_BEND_ROUNDS if len(share) else 0):
        between = (1.0 - share) * level[before] + share * level[before + 1]
        # Within one piece the place further down falls as the point itself does.
        most = np.where(same, level[before + 1] + bank / np.maximum(share, 1e-9), between + bank)
        if (level[bends.upper] <= most + 1e-6).all():
            break
        lowered = level + LEAST_FALL * arc
        np.minimum.at(lowered, bends.upper, most + LEAST_FALL * arc[bends.upper])
        lowered = np.minimum.accumulate(lowered) - LEAST_FALL * arc
        level = np.where(level > lowered + 1e-9, lowered, level)  # the rest stays to the bit
    return level


def _blurred(values: Float64Array, sigma: float) -> Float64Array:
    return smoothed(values[:, None], max(sigma, 1e-3))[:, 0]
