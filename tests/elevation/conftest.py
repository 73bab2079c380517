"""Deterministic DEMs."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.grids import ElevationGrid

MakeGrid = Callable[..., ElevationGrid]


def ground(x: Float64Array, y: Float64Array) -> Float64Array:
    """Hills of waves from 300 m to 10 km long."""
    rng = np.random.default_rng(7)
    height = np.full(np.shape(x), 800.0)
    for _ in range(40):
        length = 300.0 * 33.0 ** rng.random()
        angle, phase = 2.0 * np.pi * rng.random(2)
        height += 0.02 * length * np.sin(2 * np.pi / length * (x * np.cos(angle) + y * np.sin(angle)) + phase)
    return height


@pytest.fixture(scope="session")
def make_grid() -> MakeGrid:
    """Return a function that samples the hills by a grid with a given middle, step, size and rotation."""

    @cache
    def make(
        step: float = 30.0,
        rows: int = 100,
        columns: int = 120,
        *,
        middle: tuple[float, float] = (5000.0, 5000.0),
        degrees: float = 0.0,
        accuracy: float = 0.0,
        offset: float = 0.0,
    ) -> ElevationGrid:
        a, d = step * math.cos(math.radians(degrees)), step * math.sin(math.radians(degrees))
        right, down = 0.5 * (columns - 1), 0.5 * (rows - 1)
        x, y = middle
        place = (a, d, x - a * right - d * down, d, -a, y - d * right + a * down)
        row, column = np.indices((rows, columns)).astype(np.float64)
        x_at, y_at = (
            place[0] * column + place[1] * row + place[2],
            place[3] * column + place[4] * row + place[5],
        )
        samples = (ground(x_at, y_at) + offset).astype(np.float32)
        return ElevationGrid(samples, place, accuracy)

    return make
