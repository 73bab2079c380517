"""Ground near the eye, from maps of few calls."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.render.near_ground import NARROWEST, NearGround
from sketchterrain.render.walk import CLEARANCE, Walk


class Counted:
    """A terrain that counts how often it is asked."""

    def __init__(self, terrain):
        self.terrain, self.calls = terrain, 0
        self.extent = terrain.extent

    def heights(self, x, y, *, cell_size=0.0):
        self.calls += 1
        return self.terrain.heights(x, y, cell_size=cell_size)


def test_heights_are_those_of_the_ground_within_a_small_part_of_the_spread(waves):
    for east, north in ((300.0, 200.0), (1e6, -4e5)):
        for spread in (0.0, 3.0, 200.0):
            x = east + np.linspace(-0.5, 0.5, 7) * spread
            y = north + np.linspace(0.5, -0.5, 7) * spread
            found = NearGround(waves)(x, y)
            assert found == pytest.approx(waves.heights(x, y), abs=0.02 + 2e-3 * spread), (east, spread)


def test_a_map_is_made_only_for_places_outside_the_last_or_closer_together(waves):
    counted = Counted(waves)
    ground = NearGround(counted)
    asked = []
    for x in ([0.0], [10.0], [-0.45 * NARROWEST], [40.0], [0.0, 500.0], [250.0], [250.0, 260.0]):
        ground(x, 0.0)
        asked.append(counted.calls)
    assert asked == [1, 1, 1, 2, 3, 4, 4]


def test_a_moving_eye_never_is_in_the_ground_and_asks_for_few_maps(waves):
    for boost in (1.0, 20.0):
        counted = Counted(waves)
        walk = Walk(NearGround(counted), (100.0, 300.0, 0.0), heading=40.0, pitch=-20.0)
        for _ in range(600):
            walk.look(0.2, 0.0)
            walk.advance(1 / 60, forward=1.0, boost=boost)
            x, y, z = walk.eye
            assert z > float(waves.heights(x, y)) + 0.9 * CLEARANCE, boost
        assert counted.calls < 60, boost
