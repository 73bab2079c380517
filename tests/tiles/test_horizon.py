"""Culling of tiles behind nearer ground."""

import numpy as np
import pytest

from sketchterrain.tiles import View
from sketchterrain.tiles.codes import Boxes
from sketchterrain.tiles.horizon import behind_ground


def boxes(*sides):
    """Boxes from west, east, south, north, bottom and top."""
    west, east, south, north, bottom, top = np.array(sides, np.float64).T
    return Boxes(np.stack([west, south, bottom], -1), np.stack([east, north, top], -1))


HILL = (100, 200, -100, 100, 60, 80)
CASES = {
    "low ground behind a hill": (
        10.0,
        (HILL, (400, 500, -50, 50, 0, 30), (400, 500, -50, 50, 0, 400), (400, 500, 600, 700, 0, 30)),
        [False, True, False, False],
    ),
    "ground before a hill": (10.0, (HILL, (20, 60, -10, 10, 0, 5)), [False, False]),
    "ground partly beside a hill": (10.0, (HILL, (400, 500, 300, 460, 0, 30)), [False, False]),
    "the ground under the eye": (10.0, ((-50, 50, -50, 50, 0, 9), (60, 70, 0, 10, 0, 5)), [False, False]),
    "due west, where bearings go from +180° to -180°": (
        10.0,
        ((-200, -100, -100, 100, 60, 80), (-500, -400, -50, 50, 0, 30)),
        [False, True],
    ),
    "a low hill seen from above": (
        500.0,
        ((1000, 1100, -800, 800, 300, 310), (1300, 1400, -50, 50, 0, 5), (5000, 5100, -50, 50, 0, 5)),
        [False, False, False],
    ),
    "close behind a high hill seen from above": (
        500.0,
        ((900, 1000, -200, 200, 480, 490), (1300, 1350, -50, 50, 0, 5)),
        [False, True],
    ),
}


def test_only_ground_wholly_behind_nearer_ground_is_hidden():
    for name, (height, ground, hidden) in CASES.items():
        view = View((0.0, 0.0, height), np.zeros((0, 4)), 1000.0)
        assert behind_ground(view, boxes(*ground)).tolist() == hidden, name


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))])
def test_no_ray_reaches_a_hidden_box(seed):
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
