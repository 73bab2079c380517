"""Automatic flights around a terrain."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.render import tour as room
from sketchterrain.render.tour import tour


def looks(views):
    along = views.target - views.eye
    return along / np.linalg.norm(along, axis=1, keepdims=True)


def test_a_tour_stays_low_over_the_sketch_and_never_is_in_the_ground(waves):
    for rivers in (waves.features.rivers, ()):
        waves.features.rivers = rivers
        flight = tour(waves, seconds=60.0)
        views = flight.at(flight.times(120))
        rise = room.RISE * waves.extent
        clearance = views.eye[:, 2] - waves.heights(views.eye[:, 0], views.eye[:, 1])
        assert clearance.min() > 0.9 * room.LOW * rise
        assert clearance.mean() < 3.0 * rise
        assert (views.eye[:, :2] > 0.0).all()
        assert (views.eye[:, :2] < waves.size).all()


def test_a_tour_has_even_speed_and_slow_turns(waves):
    flight = tour(waves, seconds=60.0)
    views = flight.at(flight.times(30))
    speed = np.linalg.norm(views.velocity, axis=1)
    assert speed.max() < 1.3 * speed.min()
    turns = np.degrees(np.arccos(np.clip((looks(views)[1:] * looks(views)[:-1]).sum(axis=1), -1, 1))) * 30
    assert turns.max() < 40.0  # degrees a second, on so small a sketch


def test_a_tour_is_as_long_as_asked_repeatable_and_closed(waves):
    flight = tour(waves, seconds=20.0)
    assert 20.0 <= flight.duration < 20.0 + 5 * room.KEY_EVERY
    assert tour(waves, seconds=20.0) == flight
    lap = tour(waves, seconds=600.0)
    assert lap.at(flight.times(30, 20.0)).eye == pytest.approx(
        flight.at(flight.times(30, 20.0)).eye, abs=1e-3
    )
    eyes = lap.at(lap.times(1)).eye
    again = np.linalg.norm(eyes[60:] - eyes[0], axis=1)
    assert again.min() < 25.0


def test_a_tour_keeps_near_water(waves):
    """The river lies along y = 500: nearer to it than a circle would be, in the mean over the round."""
    with_river = tour(waves, seconds=150.0)
    waves.features.rivers = ()
    without = tour(waves, seconds=150.0)
    distances = [np.abs(f.at(f.times(2)).eye[:, 1] - 500.0).mean() for f in (with_river, without)]
    assert distances[0] < distances[1]


def test_the_cheapest_path_is_that_of_brute_force():
    rng = np.random.default_rng(2)
    for _ in range(10):
        costs = rng.uniform(0.0, 1.0, (6, 4))
        ways = np.stack(np.meshgrid(*[np.arange(4)] * 6, indexing="ij"), axis=-1).reshape(-1, 6)
        steps = np.abs(ways - np.roll(ways, 1, axis=1))
        total = costs[np.arange(6), ways].sum(axis=1) + room._STAY * steps.sum(axis=1)
        total[(steps > 1).any(axis=1)] = np.inf
        found = room._cheapest(costs)
        assert tuple(found) == tuple(ways[np.argmin(total)])
