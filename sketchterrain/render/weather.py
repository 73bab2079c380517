"""Weather of a picture: hour, clouds, wind and haze."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    from sketchterrain.render.scene import Sketch


@dataclass(frozen=True)
class Weather:
    """Sky and wind over a terrain."""

    hour: float | None = None  # local solar time, 0 … 24; None: the sun that suits the view best
    clouds: float = 0.35  # cloud cover, 0 clear … 1 overcast
    wind: float = 4.0  # m/s
    wind_from: float = 245.0  # compass bearing that it blows from, degrees
    latitude: float = 45.0  # degrees north
    haze: float = 1.0  # aerosols: 0 none, 1 a clear day, 10 a murky one

    def __post_init__(self) -> None:
        checks = (
            ("an hour", self.hour, 0.0, 24.0),
            ("a cloud cover", self.clouds, 0.0, 1.0),
            ("a wind, in m/s,", self.wind, 0.0, 40.0),
            ("a bearing of the wind, in degrees,", self.wind_from, 0.0, 360.0),
            ("a latitude, in degrees,", self.latitude, -90.0, 90.0),
            ("a haze", self.haze, 0.0, 10.0),
        )
        for what, value, low, high in checks:
            if value is not None and not low <= value <= high:
                raise InputError(f"expected {what} in [{low:g}, {high:g}], got {value:g}")

    @property
    def drift(self) -> tuple[float, float]:
        """Wind vector, (east, north) m/s."""
        bearing = math.radians(self.wind_from)
        return -self.wind * math.sin(bearing), -self.wind * math.cos(bearing)

    @classmethod
    def from_sketch(
        cls,
        sketch: Sketch,
        *,
        hour: float | None = None,
        clouds: float | None = None,
        wind: float | None = None,
        haze: float | None = None,
    ) -> Weather:
        """Return a sketch's ``[weather]``, overridden by the values given."""
        table = dict(sketch.weather)
        at = table.pop("hour", -1.0)
        weather = cls(hour=at if at >= 0.0 else None, **table)
        given = {"hour": hour, "clouds": clouds, "wind": wind, "haze": haze}
        return replace(weather, **{name: value for name, value in given.items() if value is not None})
