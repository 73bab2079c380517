"""What the sky is like while a picture is taken: the hour, the clouds, the wind."""

from __future__ import annotations

from dataclasses import dataclass

from sketchterrain.errors import InputError

__all__ = ["Weather"]


@dataclass(frozen=True)
class Weather:
    """The sky over a terrain.

    Attributes
    ----------
    hour : float or None
        Local solar time, in [0, 24]; None: whichever light models the ground best.
    clouds : float
        Share of the sky that clouds cover, 0 clear … 1 overcast.
    wind : float
        m/s, moves plants and clouds.
    wind_from : float
        Compass bearing that the wind blows from, degrees.
    """

    hour: float | None = None
    clouds: float = 0.42
    wind: float = 4.0
    wind_from: float = 245.0

    def __post_init__(self) -> None:
        if self.hour is not None and not 0.0 <= self.hour <= 24.0:
            raise InputError(f"expected an hour in [0, 24], got {self.hour:g}")
        if not 0.0 <= self.clouds <= 1.0:
            raise InputError(f"expected a cloud cover in [0, 1], got {self.clouds:g}")
