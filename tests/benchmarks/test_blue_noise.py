"""The benchmark of scattered points: its measures where the answer is known, and what its tables compare."""

from typing import Any

import numpy as np
import pytest

from sketchterrain.benchmarks import blue_noise
from sketchterrain.benchmarks.baselines.dart_thrower import throw_darts
from sketchterrain.benchmarks.outcome import Outcome
from sketchterrain.benchmarks.point_ways import fill_of, room_of
from sketchterrain.terrain.poisson import GREATEST_DENSITY, TRIALS


@pytest.fixture(scope="module")
def outcome(context, tiny) -> Outcome:
    return blue_noise.measure(context, tiny)


def rows(outcome: Outcome, table: int) -> list[Any]:
    return list(outcome.tables[table].rows)


def test_room_and_fill_of_known_points():
    inner = 16.0  # a side of 20 without two distances on either side
    room = room_of(np.array([[10.0, 10.0]]), 20.0, places=200_000, seed=1)
    assert room == pytest.approx(1.0 - np.pi / inner**2, abs=1e-3)
    # Points near the border do not count.
    grid = np.stack(np.meshgrid(np.arange(0.5, 20.0), np.arange(0.5, 20.0)), axis=-1).reshape(-1, 2)
    doubled = np.concatenate([grid, grid[grid[:, 0] < 2.0] + 0.1])
    assert fill_of(grid, 20.0) == pytest.approx(1.0 / GREATEST_DENSITY)
    assert fill_of(doubled, 20.0) == fill_of(grid, 20.0)


@pytest.mark.slow
def test_darts_fill_all_and_leave_no_room():
    darts = throw_darts(60.0, seed=4)
    assert room_of(darts, 60.0, places=50_000, seed=2) == 0.0
    assert fill_of(darts, 60.0) == pytest.approx(1.0, abs=0.02)
    fewer = darts[: len(darts) // 2]
    assert fill_of(fewer, 60.0) == pytest.approx(0.5, abs=0.03)
    assert room_of(fewer, 60.0, places=50_000, seed=2) > 0.15


@pytest.mark.slow
def test_the_default_leaves_less_than_a_percent_of_room_and_fills_nine_tenths(context):
    _, points = blue_noise.own(context, 128.0, TRIALS).run(3)
    assert room_of(points, 128.0, places=200_000, seed=5) < 0.01
    assert fill_of(points, 128.0) >= 0.90
