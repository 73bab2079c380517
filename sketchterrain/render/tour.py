"""Automatic flight over a sketch: a closed loop around its centre along valleys and water."""

from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, gaussian_filter1d, maximum_filter

from sketchterrain.array_types import Float64Array
from sketchterrain.render.flight import Flight, Keyframe
from sketchterrain.render.scene import HeightMap, TerrainSource, sample_heights
from sketchterrain.render.views import water_map

FOV: Final = 50.0
TEXELS: Final = 256
BEARINGS: Final = 72  # directions from the centre
RADII: Final = np.linspace(0.16, 0.42, 27)  # candidate radii of the loop, in sizes of the sketch
RISE: Final = 0.028  # height above the terrain, in extents …
RISE_LIMITS: Final = (25.0, 140.0)  # … limited in m
SPEED: Final = 0.75  # heights above the terrain per second
KEY_EVERY: Final = 1.5  # s
LOOK_AHEAD: Final = 5.0  # s along the loop …
LOOK_IN: Final = 0.25  # … and this share towards the centre
LOOK_DOWN: Final = -9.0  # Degrees
LOW: Final = 0.45  # least clearance, as share of the height above the terrain
_STAY = 0.10  # cost of changing the radius by a step
_WATER = 1.2  # gain of water, in ranges of terrain height
_MIDDLE = 0.20  # cost of the smallest and largest radius, in the same unit


def tour(terrain: TerrainSource, *, seconds: float = 20.0) -> Flight:
    """Return a flight of at least `seconds` over an endless terrain, deterministic; the loop repeats."""
    east, north = terrain.size
    extent = terrain.extent
    relief = sample_heights(terrain, (east / 2, north / 2), 1.2 * extent, TEXELS)
    rise = float(np.clip(RISE * extent, *RISE_LIMITS))
    speed = SPEED * rise
    loop = _resampled(_loop_positions(terrain, relief), speed * KEY_EVERY)
    keys = len(loop)
    ahead = max(round(LOOK_AHEAD / KEY_EVERY), 1)
    # A whole loop and some keyframes after the end: the path does not depend on the duration.
    count = int(np.ceil(seconds / KEY_EVERY)) + 4
    number = np.arange(max(count, keys))
    points = loop[number % keys]
    eyes = np.column_stack([points, _heights(relief, loop, rise)[number % keys]])
    ahead_points = loop[(number + ahead) % keys]
    ahead_points = ahead_points + LOOK_IN * (np.array([east, north]) / 2 - ahead_points)
    along = ahead_points - points
    distance = np.linalg.norm(along, axis=1)
    drop = distance * np.tan(np.radians(LOOK_DOWN))
    targets = np.column_stack([ahead_points, eyes[:, 2] + drop])
    rows = zip(eyes.tolist(), targets.tolist(), strict=True)
    flight = Flight(
        tuple(Keyframe(KEY_EVERY * i, tuple(eye), tuple(target), FOV) for i, (eye, target) in enumerate(rows))
    )
    return Flight(flight.raised_above(terrain.heights, clearance=LOW * rise).keys[:count])


def _loop_positions(terrain: TerrainSource, relief: HeightMap) -> Float64Array:
    """Return a closed path around the centre, (n, 2; m), that starts before its cheapest part."""
    size = np.array(terrain.size)
    angle = 2.0 * np.pi * np.arange(BEARINGS) / BEARINGS
    spoke = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    positions = size / 2 + RADII[None, :, None] * spoke[:, None, :] * size
    costs = _costs(terrain, relief, positions)
    radius = _cheapest(costs)
    gain = -costs[np.arange(BEARINGS), radius]
    fractions = _smooth(RADII[radius])
    start = int(np.argmax(_smooth(gain))) - BEARINGS // 24
    return np.roll(size / 2 + fractions[:, None] * spoke * size, -start, axis=0)


def _costs(terrain: TerrainSource, relief: HeightMap, positions: Float64Array) -> Float64Array:
    """Return costs (b, r) of flying over positions (b, r, 2): heights cost, water gains."""
    mask = water_map(terrain, relief)
    water = replace(mask, heights=gaussian_filter(mask.heights, 3.0))
    x, y = positions[..., 0], positions[..., 1]
    heights, is_water = relief.at(x, y), water.at(x, y)
    low, high = np.percentile(heights, [5, 95])
    offset = (RADII - RADII.mean()) / np.ptp(RADII) * 2.0
    return np.asarray(
        (heights - low) / max(high - low, 1.0)
        - _WATER * is_water / max(float(is_water.max()), 1e-6) * bool(is_water.any())
        + _MIDDLE * offset**2
    )


def _cheapest(costs: Float64Array) -> npt.NDArray[np.intp]:
    """Return the cheapest closed path through costs (b, r), with radius steps of at most one a bearing."""
    bearings, radii = costs.shape
    far = np.full((radii, 1), np.inf)
    start = np.where(np.eye(radii, dtype=bool), costs[0], np.inf)  # by where it starts, and where it is
    total, step_taken = start, np.zeros((bearings, radii, radii), np.intp)
    for bearing in [*range(1, bearings), 0]:
        candidates = np.stack(
            [
                np.hstack([far, total[:, :-1]]) + _STAY,
                total,
                np.hstack([total[:, 1:], far]) + _STAY,
            ]
        )
        step_taken[bearing] = np.argmin(candidates, axis=0) - 1
        total = candidates.min(axis=0) + (costs[bearing] if bearing else 0.0)
    first = at = int(np.argmin(np.diagonal(total)))
    path = np.empty(bearings, np.intp)
    for bearing in [0, *range(bearings - 1, 0, -1)]:
        at += int(step_taken[bearing, first, at])
        path[bearing - 1] = at
    return path


def _heights(relief: HeightMap, loop: Float64Array, rise: float) -> Float64Array:
    """Return smooth flight heights of the keyframes above all nearby terrain."""
    texels = max(round(rise / relief.texel), 1)
    near = replace(relief, heights=maximum_filter(relief.heights, 2 * texels + 1, mode="nearest"))
    return _smooth(near.at(loop[:, 0], loop[:, 1])) + rise


def _smooth(values: Float64Array) -> Float64Array:
    """Smooth values around a circle."""
    return np.asarray(gaussian_filter1d(values, 1.5, mode="wrap"))


def _resampled(loop: Float64Array, step: float) -> Float64Array:
    """Return points of a closed path about `step` apart, at least four."""
    closed = np.concatenate([loop, loop[:1]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = max(round(arc[-1] / step), 4)
    along = np.arange(count) * (arc[-1] / count)
    return np.column_stack([np.interp(along, arc, closed[:, axis]) for axis in (0, 1)])
