"""Landforms, key saddles and bends of rivers: each loop against NumPy or plain Python on small input."""

import math

import numpy as np
import pytest

from sketchterrain.host.library import host_function
from sketchterrain.measure.realism_metrics import key_saddles

TABLE = np.arange(81, dtype=np.int8).reshape(9, 9)


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (2, 2), (9, 7)])
@pytest.mark.parametrize("horizon", [1, 3, 24])
def test_directions_are_lower_or_higher_by_their_horizons(shape, horizon):
    z = np.round(np.random.default_rng(0).normal(size=shape), 1)
    expected = np.zeros(shape, np.int8)
    for i, j in np.ndindex(shape):
        for a, b in ((a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b):
            reach = range(1, int(horizon / math.hypot(a, b)) + 1)
            seen = [k for k in reach if 0 <= i + k * a < shape[0] and 0 <= j + k * b < shape[1]]
            angles = [math.atan2(z[i + k * a, j + k * b] - z[i, j], k * math.hypot(a, b) * 2.0) for k in seen]
            both = max(angles) + min(angles) if angles else 0.0
            expected[i, j] += 9 * (both < -0.3) + (both > 0.3)
    found = np.empty(shape, np.int8)
    host_function("geomorphons")(z, 2.0, 0.3, horizon, TABLE, found, np.empty((2, shape[1])))
    assert np.array_equal(found, expected)


def region_above(z, start, level):
    """Return the cells connected with one, none of which is below a level."""
    region, queue = {start}, [start]
    for i, j in queue:
        for cell in ((p, q) for p in range(i - 1, i + 2) for q in range(j - 1, j + 2)):
            inside = 0 <= cell[0] < z.shape[0] and 0 <= cell[1] < z.shape[1]
            if inside and cell not in region and z[cell] >= level:
                region.add(cell)
                queue.append(cell)
    return region


@pytest.mark.parametrize("shape", [(0, 4), (1, 1), (1, 9), (8, 9)])
def test_key_saddle_is_the_highest_level_that_leads_to_higher_ground(shape):
    z = np.random.default_rng(1).permutation(shape[0] * shape[1]).reshape(shape) * 1.0
    expected = []
    for cell in map(tuple, np.argwhere(z < z.max(initial=0.0))):
        levels = sorted((z[other] for other in np.ndindex(shape) if z[other] <= z[cell]), reverse=True)
        saddle = next(
            level for level in levels if max(z[at] for at in region_above(z, cell, level)) > z[cell]
        )
        if z[cell] - saddle >= 2.0 and saddle != z[cell]:
            expected.append((z[cell], saddle))
    summit, saddle = key_saddles(z, 2.0)
    assert sorted(zip(summit, saddle, strict=True)) == sorted(expected)


@pytest.mark.parametrize("points", [1, 2, 40])
def test_banks_in_bends_are_nearest_to_points_further_down(points):
    turn = np.linspace(0.0, 6.0, points)
    line = np.stack([30.0 * np.cos(turn) + turn, 30.0 * np.sin(turn)], axis=-1)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    width, normals = 12.0 + np.arange(points) % 5, np.stack([line, -line]) / 30.0
    banks = np.array([-1.5, 1.0])
    middle = np.arange(4 * points - 3) / 4.0
    at = np.stack([np.interp(middle, np.arange(points), line[:, k]) for k in range(2)], axis=-1)
    expected = []
    for p in range(points):
        reach = 4.0 * width[p]
        near = (arc[middle.astype(int)] >= arc[p] - reach) & (
            middle <= np.flatnonzero(arc - arc[p] < reach).max()
        )
        for bank in banks:
            for normal in normals:
                away = np.where(near, np.hypot(*(line[p] + bank * width[p] * normal[p] - at).T), np.inf)
                nearest = int(np.argmin(away))
                lower = min(0.25 * (nearest + 1), points - 1.0)
                if lower > p + 0.25:
                    here = np.interp(0.25 * nearest, np.arange(points), width)
                    expected.append((p, lower, away[nearest] / (0.5 * here)))
    found = np.empty(4 * points, np.int64), np.empty(4 * points), np.empty(4 * points)
    scratch = np.empty((4 * points, 2))
    count = host_function("nearest_below")(line, arc, width, normals, banks, 4.0, *found, scratch)
    assert count == len(expected)
    assert points < 3 or count > 5
    np.testing.assert_allclose(
        np.stack([each[:count] for each in found], axis=-1), np.reshape(expected, (-1, 3))
    )
