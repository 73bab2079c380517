from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.tiles import View
from sketchterrain.tiles.codes import Boxes
from sketchterrain.tiles.horizon import behind_ground

VIEW = View((0.0, 0.0, 10.0), np.zeros((0, 4)), 1000.0)


def boxes(*sides):
    """Boxes from west, east, south, north, bottom and top."""
    west, east, south, north, bottom, top = np.array(sides, np.float64).T
    return Boxes(np.stack([west, south, bottom], -1), np.stack([east, north, top], -1))


def test_a_hill_hides_what_is_low_and_behind_it():
    hill = (100, 200, -100, 100, 60, 80)
    low, high, aside, before = (
        (400, 500, -50, 50, 0, 30),
        (400, 500, -50, 50, 0, 400),
        (400, 500, 600, 700, 0, 30),
        (20, 60, -10, 10, 0, 5),
    )
    hidden = behind_ground(VIEW, boxes(hill, low, high, aside, before))
    assert hidden.tolist() == [False, True, False, False, False]


def test_a_hill_hides_only_what_lies_wholly_behind_it():
    hill = (100, 200, -100, 100, 60, 80)
    assert not behind_ground(VIEW, boxes(hill, (400, 500, 300, 460, 0, 30)))[1]


def test_the_ground_that_one_stands_on_hides_nothing():
    assert not behind_ground(VIEW, boxes((-50, 50, -50, 50, 0, 9), (60, 70, 0, 10, 0, 5))).any()


def test_across_the_seam_of_bearings():
    """Due west, bearings go from +180° to -180°."""
    hidden = behind_ground(VIEW, boxes((-200, -100, -100, 100, 60, 80), (-500, -400, -50, 50, 0, 30)))
    assert hidden.tolist() == [False, True]


def test_from_above_a_low_hill_hides_only_the_ground_close_behind():
    view = View((0.0, 0.0, 500.0), np.zeros((0, 4)), 1000.0)
    hill = (1000, 1100, -800, 800, 300, 310)
    near, far = (1300, 1400, -50, 50, 0, 5), (5000, 5100, -50, 50, 0, 5)
    assert behind_ground(view, boxes(hill, near, far)).tolist() == [False, False, False]
    close = (1300, 1350, -50, 50, 0, 5)
    steep = (900, 1000, -200, 200, 480, 490)
    assert behind_ground(view, boxes(steep, close)).tolist() == [False, True]


@pytest.mark.parametrize("seed", range(6))
def test_no_ray_reaches_what_is_hidden(seed):
    """Columns of ground on a grid; rays from the eye to the tops of hidden ones all pass through another."""
    rng = np.random.default_rng(seed)
    width, n = 50.0, 24
    col, row = np.meshgrid(np.arange(-n, n), np.arange(-n, n))
    west, south = col.ravel() * width, row.ravel() * width
    bottom = 40.0 * rng.random(west.size) ** 3
    top = bottom + 10.0 * rng.random(west.size)
    eye = np.array([rng.uniform(-20, 20), rng.uniform(-20, 20), 30.0])
    ground = boxes(*zip(west, west + width, south, south + width, bottom, top, strict=True))
    hidden = behind_ground(View(tuple(eye), np.zeros((0, 4)), 1000.0), ground)
    assert hidden.sum() > 20
    along = np.linspace(0.0, 1.0, 4000)[1:-1]
    for index in rng.choice(np.flatnonzero(hidden), 20, replace=False):
        target = np.array(
            [west[index] + rng.random() * width, south[index] + rng.random() * width, top[index]]
        )
        ray = eye + along[:, None] * (target - eye)
        i = ((ray[:, 1] // width + n) * 2 * n + ray[:, 0] // width + n).astype(int)
        assert ((ray[:, 2] < bottom[i]) & (i != index)).any()
