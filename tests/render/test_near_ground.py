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


@pytest.mark.parametrize("place", [(300.0, 200.0), (1e6, -4e5)])
@pytest.mark.parametrize("spread", [0.0, 3.0, 200.0])
def test_it_is_the_ground_within_a_small_part_of_the_spread(waves, place, spread):
    ground = NearGround(waves)
    x = place[0] + np.linspace(-0.5, 0.5, 7) * spread
    y = place[1] + np.linspace(0.5, -0.5, 7) * spread
    assert ground(x, y) == pytest.approx(waves.heights(x, y), abs=0.02 + 2e-3 * spread)


def test_a_place_outside_and_places_near_one_another_make_another_map(waves):
    counted = Counted(waves)
    ground = NearGround(counted)
    asked = []
    for x in ([0.0], [10.0], [-0.45 * NARROWEST], [40.0], [0.0, 500.0], [250.0], [250.0, 260.0]):
        ground(x, 0.0)
        asked.append(counted.calls)
    assert asked == [1, 1, 1, 2, 3, 4, 4]


@pytest.mark.parametrize("boost", [1.0, 20.0])
def test_an_eye_that_moves_over_it_never_is_in_the_ground_and_asks_seldom(waves, boost):
    counted = Counted(waves)
    walk = Walk(NearGround(counted), (100.0, 300.0, 0.0), heading=40.0, pitch=-20.0)
    for _ in range(600):
        walk.look(0.2, 0.0)
        walk.advance(1 / 60, forward=1.0, boost=boost)
        x, y, z = walk.eye
        assert z > float(waves.heights(x, y)) + 0.9 * CLEARANCE
    assert counted.calls < 60
