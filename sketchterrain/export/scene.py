"""The preview's camera and light, for programs that draw the terrain themselves."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from sketchterrain.array_types import Float64Array


class SceneView(NamedTuple):
    """A camera, and the light of sun and sky in one unit; x east, y north, z up, m."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float  # vertical, degrees
    sun_azimuth: float  # compass bearing, degrees
    sun_elevation: float  # degrees
    sunlight: Float64Array  # (3,) irradiance on a surface that faces the sun, linear sRGB
    harmonics: Float64Array  # (9, 3) irradiance of the sky, see `render.sky.irradiance_harmonics`
    sky: Float64Array  # (128, 64, 3) radiance at the eye's height, see `render.sky.sky_table`
    haze: Float64Array  # (3,) extinction by aerosols at sea level, 1/m
    haze_height: float  # m over which aerosols get e times thinner
    air: Float64Array  # (3,) extinction by molecules at sea level, 1/m
    air_height: float  # m
    exposure: float  # factor of radiance before tone mapping
    weather: dict[str, Any]  # settings of the sketch's ``[weather]``

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees, −180 … 180."""
        return math.degrees(math.atan2(self.target[0] - self.eye[0], self.target[1] - self.eye[1]))

    @property
    def facts(self) -> dict[str, Any]:
        """The sidecar's entry: camera, sun and weather."""
        return {
            "camera": {"eye": list(self.eye), "target": list(self.target), "vertical_fov": self.fov},
            "sun": {"azimuth": self.sun_azimuth, "elevation": self.sun_elevation},
            "sunlight": self.sunlight.tolist(),
            "exposure": self.exposure,
            "weather": self.weather,
            "axes": "x east, y north, z up, m; azimuth clockwise from north, degrees",
        }
