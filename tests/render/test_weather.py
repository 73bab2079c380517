"""The sun by the hour, and the weather of a sketch."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.render import Camera, Weather, find_sun, sun_of
from sketchterrain.render.sunlight import sun_at
from sketchterrain.sketch import WEATHER, Sketch


def test_the_sun_culminates_at_noon_rises_at_six_and_sets_at_eighteen():
    noon = sun_at(12.0, 47.0)
    assert (noon.azimuth, noon.elevation) == (pytest.approx(180.0), pytest.approx(43.0))
    south = sun_at(12.0, -20.0)
    assert (south.azimuth % 360.0, south.elevation) == (pytest.approx(0.0, abs=1e-9), pytest.approx(70.0))
    for latitude in (-60.0, 0.0, 45.0):
        rise, set_ = sun_at(6.0, latitude), sun_at(18.0, latitude)
        assert rise.elevation == pytest.approx(0.0, abs=1e-9), latitude
        assert rise.azimuth == pytest.approx(90.0), latitude
        assert set_.azimuth == pytest.approx(270.0), latitude


def test_the_sun_moves_smoothly_from_east_to_west():
    suns = [sun_at(hour, 45.0) for hour in np.linspace(5.7, 18.3, 200)]
    azimuth = np.array([sun.azimuth for sun in suns])
    assert (np.diff(azimuth) > 0.0).all()
    steps = np.diff([sun.direction for sun in suns], axis=0)
    assert np.linalg.norm(steps, axis=1).max() < 0.02


def test_hours_of_the_night_are_refused_with_those_of_the_day():
    with pytest.raises(InputError, match=r"from 5:38 to 18:22.*45°, got 3:30") as caught:
        sun_at(3.5, 45.0)
    assert "\n" not in str(caught.value)
    for hour in (5 + 38 / 60, 18 + 22 / 60):
        assert -4.0 <= sun_at(hour, 45.0).elevation < -3.6


def test_arguments_override_the_weather_of_the_sketch():
    sketch = Sketch(weather={"hour": 7.5, "clouds": 1.0, "haze": 2.0})
    assert Weather.of(sketch) == Weather(hour=7.5, clouds=1.0, haze=2.0)
    assert Weather.of(sketch, hour=12.0, clouds=0.0) == Weather(hour=12.0, clouds=0.0, haze=2.0)
    assert Weather.of(Sketch()) == Weather()
    assert Weather.of(SimpleNamespace(weather={})) == Weather()


def test_weather_has_the_ranges_of_the_sketch():
    for name, parameter in WEATHER.items():
        low = max(parameter.low, 0.0) if name == "hour" else parameter.low
        for value in (low, parameter.high):
            dataclasses.replace(Weather(), **{name: value})
        for value in (low - 0.01, parameter.high + 0.01, np.nan):
            with pytest.raises(InputError, match="expected"):
                dataclasses.replace(Weather(), **{name: value})


def test_the_sun_follows_the_hour_or_the_view_and_drift_follows_the_wind(waves):
    camera = Camera((500.0, 100.0, 130.0), (500.0, 800.0, 60.0))
    assert sun_of(waves, camera, Weather()) == find_sun(waves, camera)
    assert sun_of(waves, camera, Weather(hour=12.0, latitude=30.0)) == sun_at(12.0, 30.0)

    assert np.allclose(Weather(wind=3.0, wind_from=270.0).drift, (3.0, 0.0))
    assert np.allclose(Weather(wind=2.0, wind_from=0.0).drift, (0.0, -2.0))
