"""Features at nodes, means and adjustment of their factors, against NumPy."""

import numpy as np
import pytest
from scipy.ndimage import correlate1d

from sketchterrain.host.library import host_function

SHAPES = [(0, 3, 4), (1, 1, 1), (2, 1, 9), (5, 17, 12)]
"""Numbers of features, rows and columns."""
REACH, NEIGHBOUR = 0.9, 0.15


def features(count, rows, columns):
    rng = np.random.default_rng(count)
    x, y = rng.uniform(-3.0, [[columns + 3.0], [rows + 3.0]], (2, count))
    return x, y, rng.uniform(1.0, 6.0, count)


def distances(x, y, rows, columns):
    """Return distances (features, rows, columns) of nodes from features."""
    return np.hypot(np.arange(columns) - x[:, None, None], np.arange(rows)[:, None] - y[:, None, None])


def weights(x, y, radius, belongs, region):
    """Return the weights of features (features, rows, columns) at nodes."""
    own = radius[:, None, None]
    t = 1.0 - distances(x, y, *region.shape) / ((1.0 + REACH) * own + 2.0)
    foreign = (region >= 0) & (region != belongs[:, None, None])
    return np.where(t > 0.0, t**3 * own**2, 0.0) * np.where(foreign, NEIGHBOUR, 1.0)


@pytest.mark.parametrize(("count", "rows", "columns"), SHAPES)
def test_nearness_is_the_greatest_depth_within_the_zone(count, rows, columns):
    x, y, radius = features(count, rows, columns)
    near = np.full((rows, columns), -9.0)
    host_function("feature_nearness")(x, y, radius, 1.2, near)
    away, own = distances(x, y, rows, columns), radius[:, None, None]
    depth = np.where(away < 2.2 * own + 2.0, 1.0 - away / own, -9.0)
    np.testing.assert_allclose(near, depth.max(axis=0, initial=-9.0), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("count", "rows", "columns"), SHAPES)
def test_means_of_features_at_nodes(count, rows, columns):
    rng = np.random.default_rng(1)
    x, y, radius = features(count, rows, columns)
    values, belongs = rng.normal(size=(count, 5)), rng.integers(-1, 2, count)
    region = rng.integers(-1, 2, (rows, columns), np.int32)
    shape = rows, columns
    depth, owner, means = np.empty(shape), np.empty(shape, np.int64), np.zeros((*shape, 5))
    given = x, y, radius, values, belongs, region, -9.0
    host_function("features_at")(*given, depth, owner, means, np.zeros((4, *shape)))
    weight = weights(x, y, radius, belongs, region)
    total = weight.sum(axis=0)
    within = total > 0.0
    divisor = np.where(within, total, 1.0)
    expected = np.einsum("kij,km->ijm", weight, values) / divisor[..., None]
    np.testing.assert_allclose(means, expected, rtol=0, atol=1e-10)
    inside = np.where(weight > 0.0, radius[:, None, None] - distances(x, y, rows, columns), -np.inf)
    wide = np.einsum("kij,k->ij", weight, radius) / divisor
    deep = np.maximum(inside.max(axis=0, initial=-np.inf) / np.where(within, wide, 1.0), -1.0)
    np.testing.assert_allclose(depth, np.where(within, deep, -9.0), rtol=0, atol=1e-10)
    if count:
        share = inside / radius[:, None, None]
        deepest = np.where(share.max(axis=0) > 0.2, share.argmax(axis=0), -1)
        np.testing.assert_array_equal(owner, deepest)


@pytest.mark.parametrize(("count", "rows", "columns"), SHAPES)
def test_factors_are_averaged_and_adjusted_at_coarse_nodes(count, rows, columns):
    rng = np.random.default_rng(2)
    x, y, radius = features(count, rows, columns)
    factors, belongs = rng.uniform(0.2, 6.0, count), rng.integers(-1, 2, count)
    region = rng.integers(-1, 2, (rows, columns), np.int32)
    coarse = np.s_[0::2, 0::2]
    mean = np.zeros(region[coarse].shape)
    given = x, y, radius, factors, belongs, region, 0, 0, 2
    host_function("mean_factors")(*given, mean, np.zeros(mean.shape))
    weight = weights(x, y, radius, belongs, region)[:, *coarse]
    total = weight.sum(axis=0)
    expected = np.einsum("kij,k->ij", weight, factors) / np.where(total > 0.0, total, 1.0)
    np.testing.assert_allclose(mean, np.where(total > 0.0, expected, 1.0), rtol=0, atol=1e-12)
    effect, below = rng.normal(50.0, 30.0, (2, *mean.shape))
    target, owner = rng.uniform(0.0, 200.0, region.shape), rng.integers(-1, max(count, 1), region.shape)
    owner[owner >= count] = -1
    adjusted, group = factors.copy(), np.arange(count) // 2
    given = effect, below, target, owner, group, 1e-3, 0, 0, 2, 0.7
    host_function("adjust_factors")(*given, adjusted, np.empty(count))
    for axis in (0, 1):
        effect = correlate1d(effect, [0.125, 0.75, 0.125], axis, mode="nearest")
    rise = target[coarse] - below
    for k in range(count):
        of_group = (group[owner[coarse]] == group[k]) & (owner[coarse] >= 0) & (rise > 1e-3)
        reached = (effect[of_group] / rise[of_group]).max(initial=0.0)
        change = np.clip(1.0 / reached, 1.0 / 1.5, 1.5) if reached > 0.0 else 1.0
        aim = np.clip(factors[k] * (1.0 + 0.7 * (change - 1.0)), 0.1, 8.0)
        assert adjusted[k] == pytest.approx(aim if reached > 0.0 else factors[k], rel=1e-12)
