"""Kinds of views of a terrain, and the automatic tour through it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, gaussian_filter1d, maximum_filter

from sketchterrain.array_types import Bounds, Float64Array
from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.flight import Flight, Keyframe
from sketchterrain.render.scene import (
    BoundedTerrain,
    HeightMap,
    TerrainSource,
    sample_heights,
    surface_heights,
    visible_rectangle,
)
from sketchterrain.render.sky import Weather
from sketchterrain.render.viewpoints import (
    Visibility,
    aim,
    eye_level_view,
    grid_positions,
    is_inside,
    neighbouring_bearings,
    painted_sums,
    ray_positions,
    shape_mask,
    sun_preference,
)

VIEWS: Final = ("auto", "ground", "hill", "air", "layers")  # view kinds; see `find_view`
VIEWPOINTS_PER_SIDE: Final = 14  # candidate viewpoints along each side of the sketch
BEARINGS: Final = 60
LOWEST: Final = -0.38  # tangent of the lower border of a picture, about
DISTANCES: Final = 56
WATER_LIMIT: Final = 0.15
"""Share of water in the visible terrain, by apparent size, above which it is penalised."""


_PITCHES: Final = np.radians([25.0, 35.0, 50.0, 70.0])  # below the horizon, of views that frame something


class _ViewStyle(NamedTuple):
    """Eye height, framing and scoring parameters of a view kind."""

    rises: tuple[float, ...]  # heights of the eye above the terrain, in extents …
    limits: tuple[float, float]  # … limited in m
    fov: float
    horizon_at: float  # position of the horizon, in half heights above the picture's centre
    peak: tuple[float, float]  # best tangent of the highest skyline's elevation, and its width
    in_view: int  # neighbouring bearings in a picture
    clear: float  # least tangent of depression of near terrain, which otherwise occludes the rest
    near: float  # extents up to which terrain is near
    wall: float  # penalty of higher near terrain, per tangent
    inside: float  # weight of visible terrain being inside the sketch
    water: float  # apparent size of water that saturates its score


_STYLES: Final = {
    # Above the trees, but low enough that they are recognisable.
    "auto": _ViewStyle(
        rises=(0.010,),
        limits=(20.0, 190.0),
        fov=36.0,
        horizon_at=0.34,
        peak=(0.18, 0.10),
        in_view=9,
        clear=0.06,
        near=0.10,
        wall=14.0,
        inside=0.8,
        water=0.012,
    ),
    "air": _ViewStyle(
        rises=(0.035, 0.05, 0.07),
        limits=(250.0, 700.0),
        fov=40.0,
        horizon_at=0.40,
        peak=(0.06, 0.07),
        in_view=13,
        clear=0.30,
        near=0.22,
        wall=30.0,
        inside=2.0,
        water=0.004,
    ),
}


def find_view(
    terrain: TerrainSource,
    kind: str = "auto",
    *,
    weather: Weather | None = None,
    framed: Bounds | None = None,
) -> Camera:
    """Return the best-scoring camera over many viewpoints and bearings; deterministic.

    Kinds: ``ground`` eye level in the open; ``hill`` the same on a rise; ``air`` 250 to 700 m up; ``auto``
    above the trees, a hundredth of the extent up (20 to 190 m). The score combines relief, visible water,
    painted features, open foreground and, if the weather has an hour, light from the side. ``layers`` shows
    all of the rectangle `framed` (m), by default the sketch, from as low as most of it is visible.
    """
    check_view(kind)
    if kind == "layers":
        return _overview(terrain, framed or visible_rectangle(terrain), weather)
    light = sun_preference(weather)
    if kind in ("ground", "hill"):
        return eye_level_view(terrain, light, raised=kind == "hill")
    style = _STYLES[kind]
    extent = terrain.extent
    west, south, east, north = visible_rectangle(terrain)
    relief = sample_heights(terrain, ((west + east) / 2, (south + north) / 2), 3.4 * extent, 576, cell=2.0)
    along = (np.arange(VIEWPOINTS_PER_SIDE) + 0.5) / VIEWPOINTS_PER_SIDE
    if not isinstance(terrain, BoundedTerrain):  # a sketch is seen from a little outside, too
        along = along * 1.1 - 0.05
    rises = len(style.rises)
    x, y = np.tile(grid_positions(terrain, along), (rises, 1)).T
    rise = np.repeat(np.clip(np.array(style.rises) * extent, *style.limits), len(x) // rises)
    z = relief.at(x, y) + rise
    bearings = np.linspace(0.0, 2.0 * np.pi, BEARINGS, endpoint=False)
    distances = np.asarray(extent * np.geomspace(0.012, 1.6, DISTANCES), dtype=np.float64)
    seen = _compute_visibility(terrain, relief, np.stack([x, y, z], axis=1), bearings, distances, style)
    score = _score(seen, style) + light(bearings)
    viewpoint, bearing = np.unravel_index(int(np.argmax(score)), score.shape)
    eye_z = float(surface_heights(terrain, x[viewpoint], y[viewpoint])) + float(rise[viewpoint])
    eye = (float(x[viewpoint]), float(y[viewpoint]), eye_z)
    skyline = neighbouring_bearings(seen.horizon, style.in_view)[:, viewpoint, bearing]
    angle = float(bearings[bearing])
    return aim(eye, angle, skyline, extent, fov=style.fov, horizon_at=style.horizon_at)


def _overview(terrain: TerrainSource, box: Bounds, weather: Weather | None) -> Camera:
    """Return the camera that sees the most of a rectangle."""
    west, south, east, north = box
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(west, east, 9), np.linspace(south, north, 9)))
    points = np.stack([x, y, surface_heights(terrain, x, y)], axis=-1).astype(np.float64)
    middle, fov = 0.5 * (points.min(axis=0) + points.max(axis=0)), _STYLES["air"].fov
    away = max(np.linalg.norm(points - middle, axis=1).max(), 50.0) / np.sin(np.radians(0.5 * fov))
    relief = sample_heights(terrain, (middle[0], middle[1]), 2.2 * away, 384)
    pitch, bearing = np.meshgrid(_PITCHES, np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False))
    ahead = np.cos(pitch) * np.sin(bearing), np.cos(pitch) * np.cos(bearing), -np.sin(pitch)
    eyes = middle - away * np.stack(ahead, axis=-1)
    along = np.linspace(0.0, 0.98, 64)[:, None]
    lines = eyes[..., None, None, :] + along * (points[:, None] - eyes[..., None, None, :])
    clear = (relief.at(lines[..., 0], lines[..., 1]) < lines[..., 2]).all(axis=-1).mean(axis=-1)
    score = np.minimum(clear, 0.97) - 0.05 * pitch + 0.05 * sun_preference(weather)(bearing)
    eye = eyes[np.unravel_index(np.argmax(score), score.shape)]
    place, target = ((float(x), float(y), float(z)) for x, y, z in (eye, middle))
    return Camera(place, target, fov=fov, near=1.5, far=20.0 * terrain.extent)


def check_view(kind: str) -> None:
    """Raise InputError for an unknown view kind."""
    if kind not in VIEWS:
        raise InputError(f"expected a view, one of {', '.join(VIEWS)}, got {kind!r}")


def _compute_visibility(
    terrain: TerrainSource,
    relief: HeightMap,
    eyes: Float64Array,
    bearings: Float64Array,
    distances: Float64Array,
    style: _ViewStyle,
) -> Visibility:
    east, north = ray_positions(eyes, bearings, distances)
    slope = (relief.at(east, north) - eyes[:, 2, None, None]) / distances
    skyline = np.maximum.accumulate(slope, axis=-1)
    # Terrain steeper than 45° below the eye is outside any picture.
    below = np.concatenate([np.full_like(skyline[..., :1], -1.0), skyline[..., :-1]], axis=-1)
    share = np.maximum(slope - np.maximum(below, -1.0), 0.0)
    seen = share > 0.0
    far = distances > 0.06 * terrain.extent
    appears = np.diff(seen[..., far].astype(np.int8), axis=-1) > 0
    is_water = water_map(terrain, relief).at(east, north)
    size = seen * np.gradient(distances) / distances * np.clip(-slope, 0.0, 0.25)
    apparent = is_water * size * far
    flooded = (is_water * size).sum(axis=-1) / np.maximum(size.sum(axis=-1), 1e-9)
    middle = far & (distances < terrain.extent)
    extents = distances / terrain.extent
    inside = is_inside(terrain, east, north)
    return Visibility(
        skyline[..., -1],
        share[..., extents < style.near].sum(axis=-1) - 1.0,
        share[..., (extents > 0.10) & (extents < 1.2)].sum(axis=-1),
        appears.sum(axis=-1).astype(np.float64),
        apparent.sum(axis=-1),
        flooded,
        painted_sums(terrain, relief, east, north, share * middle * (slope > LOWEST)),
        (inside * share * middle).sum(axis=-1),
    )


def water_map(terrain: TerrainSource, relief: HeightMap) -> HeightMap:
    """Return a mask of the waters on the texels of a map: 1 inside, 0 outside."""
    features, level = terrain.features, terrain.sea_level
    mask = shape_mask(relief, features.lakes, features.rivers)
    if level is not None:
        mask.heights[relief.heights <= level] = 1.0
    return mask


def _score(seen: Visibility, style: _ViewStyle) -> Float64Array:
    """Return the score of each viewpoint and bearing."""

    def mean(values: Float64Array, width: int = style.in_view) -> Float64Array:
        return np.asarray(neighbouring_bearings(values, width).mean(axis=0))

    horizon = neighbouring_bearings(seen.horizon, style.in_view)
    # Terrain that rises in front of the camera occludes the rest.
    near = neighbouring_bearings(seen.near, style.in_view)
    wall = np.maximum(near + style.clear, 0.0).mean(axis=0)
    return np.asarray(
        2.2 * np.exp(-(((horizon.max(axis=0) - style.peak[0]) / style.peak[1]) ** 2))
        + 0.8 * np.tanh(horizon.std(axis=0) / 0.04)
        + 0.9 * np.tanh(mean(seen.middle) / 0.15)
        + 1.0 * np.tanh(mean(seen.layers) / 3.0)
        + 2.4 * np.tanh(mean(seen.water, 7) / style.water)
        + 2.0 * np.tanh(mean(seen.painted, 9) / 0.04).sum(axis=0)
        + style.inside * np.tanh(mean(seen.inside) / 0.15)
        - style.wall * wall
        - 6.0 * np.maximum(mean(seen.flooded) - WATER_LIMIT, 0.0)  # a lake should not fill the picture
    )


FOV: Final = 50.0
TEXELS: Final = 256
TOUR_BEARINGS: Final = 72  # directions from the centre
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
    return Flight(flight.raised_above(partial(surface_heights, terrain), clearance=LOW * rise).keys[:count])


def _loop_positions(terrain: TerrainSource, relief: HeightMap) -> Float64Array:
    """Return a closed path around the centre, (n, 2; m), that starts before its cheapest part."""
    size = np.array(terrain.size)
    angle = 2.0 * np.pi * np.arange(TOUR_BEARINGS) / TOUR_BEARINGS
    spoke = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    positions = size / 2 + RADII[None, :, None] * spoke[:, None, :] * size
    costs = _costs(terrain, relief, positions)
    radius = _cheapest(costs)
    gain = -costs[np.arange(TOUR_BEARINGS), radius]
    fractions = _smooth(RADII[radius])
    start = int(np.argmax(_smooth(gain))) - TOUR_BEARINGS // 24
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
        inner, outer = np.hstack([far, total[:, :-1]]), np.hstack([total[:, 1:], far])
        candidates = np.stack([inner + _STAY, total, outer + _STAY])
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
