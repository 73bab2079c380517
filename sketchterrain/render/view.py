"""Choose a camera that shows a terrain: water or relief as the subject, ground before it, a high horizon."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.render.camera import Camera
from sketchterrain.render.relief import HeightMap, sample_heights

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.render.scene import Terrain

    Floats = npt.NDArray[np.float64]

__all__ = ["find_view"]

FOV: Final = 36.0
ASPECT: Final = 16.0 / 9.0
STANDS: Final = 14
"""Candidate stands along each side of the sketch."""
RISES: Final = (0.008, 0.018)
"""Heights of the eye above the ground, in extents; 16 m at least, over the trees."""
BEARINGS: Final = 60
DISTANCES: Final = 56
HORIZON_AT: Final = 0.30
"""Where the horizon should lie, in half heights above the picture's middle."""


class _Panorama(NamedTuple):
    """What is seen all around from many stands, by stand, bearing and distance.

    Shares are tangents of the angle by which ground at a distance rises over all that is nearer.
    """

    horizon: Floats  # (stands, bearings) tangent of the skyline's elevation
    share: Floats  # (stands, bearings, distances)
    water: Floats  # (stands, bearings) apparent size of the visible water
    interest: Floats  # (stands, bearings) share of what was painted


def find_view(terrain: Terrain) -> Camera:
    """Choose a camera that shows a terrain. The same terrain always gives the same camera.

    Looks around from a regular grid of stands over coarse heights, and takes the stand and bearing with the
    best mix of relief, visible water, painted features and open foreground.
    """
    extent = terrain.extent
    size = np.asarray(terrain.size, dtype=np.float64)
    relief = sample_heights(terrain, (size[0] / 2, size[1] / 2), 3.4 * extent, 576)
    along = (np.arange(STANDS) + 0.5) / STANDS * 1.1 - 0.05
    x, y = (grid.ravel() for grid in np.meshgrid(along * size[0], along * size[1]))
    x, y = np.tile(x, len(RISES)), np.tile(y, len(RISES))
    rise = np.repeat(np.maximum(np.array(RISES) * extent, 16.0), len(x) // len(RISES))
    z = relief.at(x, y) + rise
    bearings = np.arange(BEARINGS) * (2.0 * np.pi / BEARINGS)
    distances = np.asarray(extent * np.geomspace(0.012, 1.6, DISTANCES), dtype=np.float64)
    seen = _look_around(terrain, relief, np.stack([x, y, z], axis=1), bearings, distances)
    score = _score(seen, distances / extent)
    stand, bearing = np.unravel_index(int(np.argmax(score)), score.shape)
    eye_z = float(terrain.heights(x[stand], y[stand])) + float(rise[stand])
    return _aim(
        (float(x[stand]), float(y[stand]), eye_z),
        float(bearings[bearing]),
        _window(seen.horizon, 9)[:, stand, bearing],
        extent,
    )


def _look_around(
    terrain: Terrain, relief: HeightMap, eyes: Floats, bearings: Floats, distances: Floats
) -> _Panorama:
    east = eyes[:, 0, None, None] + np.sin(bearings)[None, :, None] * distances
    north = eyes[:, 1, None, None] + np.cos(bearings)[None, :, None] * distances
    slope = (relief.at(east, north) - eyes[:, 2, None, None]) / distances
    skyline = np.maximum.accumulate(slope, axis=-1)
    below = np.concatenate([np.full_like(skyline[..., :1], -1.0), skyline[..., :-1]], axis=-1)
    share = np.maximum(slope - below, 0.0)
    seen = (share > 0.0) & (distances > 0)
    water, interest = _subjects(terrain, relief)
    step = np.gradient(distances)
    on_water = water.at(east, north) * seen
    apparent = on_water * step / distances * np.minimum(-slope, 0.25).clip(0.0) * (distances > distances[4])
    painted = interest.at(east, north) * share
    return _Panorama(skyline[..., -1], share, apparent.sum(axis=-1), painted.sum(axis=-1))


def _subjects(terrain: Terrain, relief: HeightMap) -> tuple[HeightMap, HeightMap]:
    """Draw where water is (0..1) and how near painted features are (0..1) on the relief's grid."""
    n = len(relief.heights)
    water = np.zeros((n, n), np.float32)
    for river in terrain.features.rivers:
        place = np.floor((river.centreline[:, :2] - [relief.west, relief.south]) / relief.texel).astype(
            np.intp
        )
        inside = ((place >= 0) & (place < n)).all(axis=1)
        share = np.minimum(river.centreline_width / relief.texel, 1.0)
        water[place[inside, 1], place[inside, 0]] = np.maximum(share[inside], 0.35)
    interest = np.zeros((n, n), np.float32)
    middles = (
        relief.west + (np.arange(n) + 0.5) * relief.texel,
        relief.south + (np.arange(n) + 0.5) * relief.texel,
    )
    inside_x = (middles[0] > 0) & (middles[0] < terrain.size[0])
    inside_y = (middles[1] > 0) & (middles[1] < terrain.size[1])
    interest[np.ix_(inside_y, inside_x)] = 0.25
    points = terrain.features.points
    if points.dtype.names and "painted" in points.dtype.names:
        for x, y, radius in points[points["painted"]][["x", "y", "radius"]].tolist():
            i, j = ((np.array([x, y]) - [relief.west, relief.south]) / relief.texel).astype(np.intp)
            reach = int(np.clip(0.6 * radius / relief.texel, 1, 40))
            interest[max(j - reach, 0) : j + reach + 1, max(i - reach, 0) : i + reach + 1] = 1.0
    return (
        HeightMap(relief.west, relief.south, relief.width, water),
        HeightMap(relief.west, relief.south, relief.width, interest),
    )


def _window(values: Floats, width: int) -> Floats:
    """Stack the values of the `width` bearings around each bearing along a new first axis."""
    return np.stack([np.roll(values, shift, axis=1) for shift in range(-(width // 2), width // 2 + 1)])


def _score(seen: _Panorama, distance: Floats) -> Floats:
    """Rate each stand and bearing; distances are in extents."""
    horizon = _window(seen.horizon, 9)
    middle = _window(seen.share[..., (distance > 0.12) & (distance < 1.2)].sum(axis=-1), 9).mean(axis=0)
    near = _window(seen.share[..., distance < 0.05].sum(axis=-1) > 1.0, 9).mean(axis=0)
    peak = horizon.max(axis=0)
    return np.asarray(
        1.6 * np.tanh(peak / 0.16)
        + 0.9 * np.tanh(horizon.std(axis=0) / 0.05)
        + 1.2 * np.tanh(middle / 0.12)
        + 1.8 * np.tanh(_window(seen.water, 7).mean(axis=0) / 0.010)
        + 1.5 * np.tanh(_window(seen.interest, 7).mean(axis=0) / 0.06)
        - 3.0 * near
        - 6.0 * np.maximum(peak - 0.30, 0.0)
    )


def _aim(eye: tuple[float, float, float], bearing: float, horizon: Floats, extent: float) -> Camera:
    """Pitch the camera so that the skyline lies in the upper third and no peak leaves the picture."""
    half = np.tan(np.radians(FOV) / 2.0)
    pitch = max(float(np.median(horizon)) - HORIZON_AT * half, float(horizon.max()) - 0.80 * half)
    ahead = 0.4 * extent
    target = (eye[0] + np.sin(bearing) * ahead, eye[1] + np.cos(bearing) * ahead, eye[2] + pitch * ahead)
    return Camera(
        eye, (float(target[0]), float(target[1]), float(target[2])), fov=FOV, near=1.5, far=20.0 * extent
    )
