"""The sun's position: by the hour, or as it suits a view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.render.scene import sample_heights
from sketchterrain.render.sky import LOWEST_SUN, Sun

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import HeightMap, TerrainSource
    from sketchterrain.render.sky import Weather


ELEVATION: Final = 27.0  # degrees: long shadows that model the ground, and still the colours of day
TO_THE_SIDE: Final = 108.0  # degrees between view and sun: side light from a little behind the photographer
STEPS: Final = 28


def sun_for_view(terrain: TerrainSource, camera: Camera, weather: Weather) -> Sun:
    """Return the sun at the weather's hour, or the one that suits the view if no hour is set."""
    if weather.hour is None:
        return find_sun(terrain, camera)
    return sun_at(weather.hour, weather.latitude)


def sun_at(hour: float, latitude: float) -> Sun:
    """Return the sun at a local solar time (h) and latitude (degrees north) on the day of an equinox.

    It rises at 6 and sets at 18 everywhere, and its noon zenith angle is the latitude: neither steep and flat
    light as in midsummer nor a long twilight. Raise `InputError` below `LOWEST_SUN`.
    """
    angle, phi = np.radians((hour - 12.0) * 15.0), np.radians(latitude)
    east, north, up = -np.sin(angle), -np.sin(phi) * np.cos(angle), np.cos(phi) * np.cos(angle)
    elevation = float(np.degrees(np.arcsin(np.clip(up, -1.0, 1.0))))
    if elevation < LOWEST_SUN - 1e-9:
        half_day = float(np.degrees(np.arccos(np.sin(np.radians(LOWEST_SUN)) / np.cos(phi)))) / 15.0
        first, last = np.ceil((12.0 - half_day) * 60.0), np.floor((12.0 + half_day) * 60.0)
        raise InputError(
            f"expected an hour from {_clock(first)} to {_clock(last)}, while the sun stands no lower than "
            f"{LOWEST_SUN:g}° at latitude {latitude:g}°, got {_clock(round(hour * 60.0))}"
        )
    return Sun(float(np.degrees(np.arctan2(east, north))) % 360.0, max(elevation, LOWEST_SUN))


def _clock(minutes: float) -> str:
    return f"{int(minutes) // 60}:{int(minutes) % 60:02d}"


def find_sun(terrain: TerrainSource, camera: Camera) -> Sun:
    """Return the sun to the left or right of a camera, whichever lights more of its view; deterministic."""
    extent = terrain.extent
    ahead = camera.forward[:2] * 0.5 * extent
    relief = sample_heights(terrain, (camera.eye[0] + ahead[0], camera.eye[1] + ahead[1]), 2.4 * extent, 320)
    bearing = np.radians(camera.heading) + np.linspace(-0.5, 0.5, 41)[:, None]
    distance = extent * np.geomspace(0.02, 1.3, 48)[None, :]
    x = camera.eye[0] + np.sin(bearing) * distance
    y = camera.eye[1] + np.cos(bearing) * distance
    seen = _share_of_picture(relief.at(x, y), camera.eye[2], distance)
    suns = [Sun((camera.heading + side * TO_THE_SIDE) % 360.0, ELEVATION) for side in (-1.0, 1.0)]
    lit = [float(np.sum(seen * _lit(relief, sun, x, y))) for sun in suns]
    return suns[int(np.argmax(lit))]


def _share_of_picture(height: Float64Array, eye: float, distance: Float64Array) -> Float64Array:
    slope = (height - eye) / distance
    skyline = np.maximum.accumulate(slope, axis=1)
    before = np.concatenate([skyline[:, :1], skyline[:, :-1]], axis=1)
    return np.asarray(np.maximum(slope - before, 0.0))


def _lit(relief: HeightMap, sun: Sun, x: Float64Array, y: Float64Array) -> Float64Array:
    """Return the cosine of incidence on the ground, 0 in the shadow of other ground."""
    east, north, up = sun.direction
    h, d = relief.at(x, y), relief.texel
    slope_x = (relief.at(x + d, y) - relief.at(x - d, y)) / (2 * d)
    slope_y = (relief.at(x, y + d) - relief.at(x, y - d)) / (2 * d)
    cosine = (up - slope_x * east - slope_y * north) / np.sqrt(1.0 + slope_x**2 + slope_y**2)
    free = np.ones(x.shape, dtype=np.bool_)
    for run in d * np.geomspace(1.5, 160.0, STEPS):
        free &= relief.at(x + east * run, y + north * run) <= h + up * run + 0.5 * d
    return np.asarray(np.maximum(cosine, 0.0) * free)
