from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from sketchterrain.errors import InputError
from sketchterrain.export.height_steps import HeightSteps

METRES = some.floats(-12_000.0, 12_000.0, width=32)


def decoded(steps: HeightSteps, numbers: np.ndarray) -> np.ndarray:
    return steps.low + numbers.astype(np.float64) * steps.range / 65536.0


@settings(deadline=None)
@given(some.lists(METRES, min_size=1, max_size=9))
def test_heights_round_trip_within_half_a_step(heights: list[float]) -> None:
    height = np.array([heights], np.float32)
    steps = HeightSteps.of(height)
    numbers = steps.encode(height)
    assert numbers.dtype == np.uint16
    off = np.abs(decoded(steps, numbers) - height.astype(np.float64))
    assert off.max() <= 0.5 * steps.step * (1.0 + 1e-9)
    assert steps.range <= max(1.0, float(np.ptp(height.astype(np.float64))) * 65536 / 65535 + 0.0025)


@settings(deadline=None)
@given(METRES, METRES)
def test_low_and_range_are_whole_millimetres(one: float, other: float) -> None:
    steps = HeightSteps.of(np.array([[one, other]], np.float32))
    for each in (steps.low, steps.range):
        assert float(f"{each:.3f}") == each


def test_the_whole_range_of_numbers_is_used_also_of_flat_and_given_ranges() -> None:
    numbers = HeightSteps.of(np.array([[0.0, 1000.0]], np.float32)).encode(
        np.array([[0.0, 1000.0]], np.float32)
    )
    assert numbers[0, 0] == 0
    assert numbers[0, 1] >= 65534

    height = np.full((3, 3), 812.5, np.float32)
    steps = HeightSteps.of(height)
    assert (steps.low, steps.range) == (812.5, 1.0)
    assert (steps.encode(height) == 0).all()

    steps = HeightSteps.of(np.array([[10.0, 20.0]], np.float32), (-100.0, 900.0))
    assert (steps.low, steps.range) == (-100.0, 1000.0)
    assert steps.step == 1000.0 / 65536.0
    assert steps.highest == pytest.approx(900.0 - steps.step)


def test_heights_out_of_range_and_bad_ranges_are_refused() -> None:
    for wanted in [(0.0, 500.0), (11.0, 1000.0), (10.0, 999.98)]:
        with pytest.raises(InputError, match=r"the terrain goes from 10\.00 to 1000\.00 m"):
            HeightSteps.of(np.array([[10.0, 1000.0]], np.float32), wanted)

    for wanted in [(5.0, 5.0), (5.0, 4.0), (float("nan"), 1.0), (0.0, float("inf"))]:
        with pytest.raises(InputError, match="expected the lowest and the highest"):
            HeightSteps.of(np.zeros((2, 2), np.float32), wanted)

    steps = HeightSteps(0.0, 100.0)
    for outside in (-0.01, 100.0):
        with pytest.raises(InputError, match="do not fit"):
            steps.encode(np.array([[outside]], np.float32))
