"""How a camera is pointed: the skyline in the upper third, the sun from the side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.render.camera import Camera
from sketchterrain.render.sunlight import sun_at

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.weather import Weather

    Light = Callable[[Float64Array], Float64Array]
    """What the light adds to views along bearings (rad)."""

HIGHEST: Final = 0.80
"""Half heights above the picture's middle that no peak rises over."""
SIDE: Final = (75.0, 45.0)
"""Degrees between the view and the sun that model the ground best, and how far from it they still do."""
LIGHT_WORTH: Final = 1.4
BEHIND: Final = 140.0
"""Degrees from which on the sun stands behind the camera, and the light is flat …"""
FLAT: Final = 0.8
"""… and what that costs."""


def sun_preference(weather: Weather | None) -> Light:
    """Return the score that the sun adds to views, by bearing: 0 without a visible sun."""
    if weather is None or weather.hour is None:
        return np.zeros_like
    sun = sun_at(weather.hour, weather.latitude)
    # A sun overhead or behind clouds has no side.
    weight = np.cos(np.radians(max(sun.elevation, 0.0))) * (1.0 - weather.clouds**2)

    def light(bearings: Float64Array) -> Float64Array:
        off = np.abs((np.degrees(bearings) - sun.azimuth + 180.0) % 360.0 - 180.0)
        side = LIGHT_WORTH * np.exp(-(((off - SIDE[0]) / SIDE[1]) ** 2))
        flat = FLAT * np.clip((off - BEHIND) / (180.0 - BEHIND), 0.0, 1.0)
        return np.asarray(weight * (side - flat))

    return light


def window(values: Float64Array, width: int) -> Float64Array:
    """Stack the values of the `width` bearings around each bearing along a new first axis."""
    return np.stack([np.roll(values, shift, axis=1) for shift in range(-(width // 2), width // 2 + 1)])


def aim(
    eye: tuple[float, float, float],
    bearing: float,
    horizon: Float64Array,
    extent: float,
    *,
    fov: float,
    horizon_at: float,
) -> Camera:
    """Pitch a camera so that the skyline lies high and no peak leaves the picture."""
    half = np.tan(np.radians(fov) / 2.0)
    pitch = max(float(np.median(horizon)) - horizon_at * half, float(horizon.max()) - HIGHEST * half)
    ahead = 0.4 * extent
    target = (eye[0] + np.sin(bearing) * ahead, eye[1] + np.cos(bearing) * ahead, eye[2] + pitch * ahead)
    return Camera(
        eye, (float(target[0]), float(target[1]), float(target[2])), fov=fov, near=1.5, far=20.0 * extent
    )
