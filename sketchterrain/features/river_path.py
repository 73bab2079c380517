"""The path of a reach: smoothed, evenly spaced, and carried on beyond the sketch's edge."""

from __future__ import annotations

import math

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.features.hashing import value_noise
from sketchterrain.features.rounding import gaussian_filter

EXTENSION_SHARE = 0.35
"""How far a river runs on beyond the sketch's edge, as a share of the sketch's longer side."""

_WIDEST_EXIT = math.radians(50.0)  # between a river's heading beyond the edge and straight out
_WANDER = 0.5  # rad to either side


def smoothed(path: Float64Array, sigma: float) -> Float64Array:
    """Smooth a path with a Gaussian of `sigma` points; its two ends stay where they are, bit for bit.

    Beyond its ends the path is continued point-symmetrically, so that it does not shrink.
    """
    pad = min(math.ceil(3.0 * sigma), len(path) - 1)
    if pad < 1:
        return path
    front, back = 2.0 * path[0] - path[pad:0:-1], 2.0 * path[-1] - path[-2 : -2 - pad : -1]
    whole = np.concatenate([front, path, back])
    smooth = gaussian_filter(whole, sigma, axes=(0,), truncate=3.0)[pad : pad + len(path)]
    smooth[[0, -1]] = path[[0, -1]]
    return smooth


def arc_length(path: Float64Array) -> Float64Array:
    """Length (m) along a path from its first point to each, from x and y."""
    steps = np.sqrt((np.diff(path[:, :2], axis=0) ** 2).sum(axis=1))
    return np.concatenate([[0.0], np.cumsum(steps)])


def spaced(path: Float64Array, interval: float) -> Float64Array:
    """Points about `interval` (m) apart along a path, with its ends; columns beyond x and y come along."""
    arc = arc_length(path)
    count = max(round(float(arc[-1]) / interval), 1) + 1
    at = np.linspace(0.0, arc[-1], count)
    points = np.stack([np.interp(at, arc, path[:, i]) for i in range(path.shape[1])], axis=-1)
    points[[0, -1]] = path[[0, -1]]
    return points


def extend_path(
    path: Float64Array, normal: tuple[float, float], *, length: float, interval: float, seed: int, name: int
) -> Float64Array:
    """Points that carry a river on beyond the sketch's edge, wandering gently.

    Parameters
    ----------
    path : (n, 2) float64
        The river (m); it goes on from its last point, with the heading it has there.
    normal : (east, north)
        Out of the sketch; the river never turns back against it.
    length, interval : float
        How far to go on (m), in which steps (m).
    seed, name : int
        Seed of the terrain, and what tells this river from others.

    Returns
    -------
    (k, 2) float64, without the path's own last point.
    """
    arc = arc_length(path)
    back = path[np.searchsorted(arc, max(arc[-1] - 3.0 * interval, 0.0), side="left")]
    heading, out = path[-1] - back, math.atan2(normal[1], normal[0])
    off = math.atan2(heading[1], heading[0]) - out if heading.any() else 0.0
    off = math.remainder(off, 2.0 * math.pi)
    off = min(max(off, -_WIDEST_EXIT), _WIDEST_EXIT)
    step = np.arange(1, max(round(length / interval), 1) + 1, dtype=np.float64)
    swing = (
        2.0 * value_noise(seed, "river beyond the edge", step / 5.0, np.full_like(step, name % 2**40)) - 1.0
    )
    angle = out + off + _WANDER * swing * np.minimum(step / 6.0, 1.0)
    steps = interval * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(path[-1] + np.cumsum(steps, axis=0))
