"""Hashes, profiles, densities, distances, rounding."""

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.geometry.hashing import STEP, gaussian_filter, hash_keys, hash_unit, rounded, value_noise
from sketchterrain.landforms.placement.feature_types import (
    VISIBLE_SHARE,
    flank,
    hill_profile,
    mountain_profile,
    visible_radius,
)
from sketchterrain.landforms.placement.placement import PaintedDistance, cubic, density_around


def test_hashes_depend_on_every_key_and_are_uniform_uncorrelated_and_smooth():
    keys = np.arange(1000)
    first = hash_keys(7, "a", keys, 3)
    np.testing.assert_array_equal(first, hash_keys(7, "a", keys, 3))
    np.testing.assert_array_equal(first[500:], hash_keys(7, "a", keys[500:], 3))
    for other in (hash_keys(8, "a", keys, 3), hash_keys(7, "b", keys, 3), hash_keys(7, "a", keys, 4)):
        assert not np.any(first == other)
    keys = np.array([-1, 0, 1, -(2**62), 2**62], dtype=np.int64)
    assert len(np.unique(hash_keys(2**63 - 1, "a", keys))) == 5
    assert hash_keys(0, "a", -1) == hash_keys(0, "a", np.array(-1))

    values = hash_unit(1, "even", np.arange(100_000))
    assert 0.0 <= values.min() < values.max() < 1.0
    counts = np.bincount((values * 20).astype(int), minlength=20)
    assert np.abs(counts - 5000).max() < 5 * np.sqrt(5000)
    values = values - 0.5
    assert abs(np.mean(values[1:] * values[:-1])) < 5 / 12 / np.sqrt(1e5)

    x = np.linspace(-30.0, 30.0, 60_001)
    noise = value_noise(5, "n", x, np.full_like(x, 0.3))
    assert 0.0 <= noise.min() < 0.25
    assert 0.75 < noise.max() <= 1.0
    assert np.abs(np.diff(noise)).max() < 1.6e-3  # slope at most 1.5 a unit


T = np.linspace(0.0, 1.0, 2001)


def test_profiles_fall_from_one_to_zero_and_reach_a_quarter_at_the_visible_radius():
    for fidelity in (0.0, 0.8, 0.9, 1.0):
        for profile in (hill_profile(T, flank(fidelity)), mountain_profile(T, 0.5, flank(fidelity))):
            assert profile[0] == pytest.approx(1.0)
            assert profile[-1] == 0.0
            assert np.all(np.diff(profile) <= 1e-12), fidelity
        assert np.all(hill_profile(np.array([1.0, 1.5, 9.0]), flank(fidelity)) == 0.0)

    slope = -np.gradient(hill_profile(T, 1.0), T)
    assert slope[0] == pytest.approx(0.0, abs=0.02)
    foot = T > 0.6  # from a quarter of the height down
    line = np.polyval(np.polyfit(T[foot], slope[foot], 1), T[foot])
    assert np.abs(slope[foot] - line).max() < 0.04 * slope.max()

    share = np.array([0.36, 0.6, 1.0])
    at = visible_radius("hill", share, np.zeros(3), 0.8)
    assert share * hill_profile(at, flank(0.8)) == pytest.approx(np.full(3, VISIBLE_SHARE), abs=1e-6)
    peaks = np.array([0.0, 0.5, 1.0])
    relative = share * mountain_profile(visible_radius("mountain", share, peaks, 1.0), peaks, flank(1.0))
    assert relative == pytest.approx(np.full(3, VISIBLE_SHARE), abs=1e-6)


def test_density_is_the_plain_sum_also_for_groups_and_empty_fields():
    rng = np.random.default_rng(2)
    points, sizes = rng.random((200, 2)) * 100, rng.random(200) + 0.5
    at, radius = rng.random((50, 1, 2)) * 100, rng.random(50) * 30 + 1
    weight = cubic(np.linalg.norm(at - points, axis=-1) / radius[:, None]) * sizes
    np.testing.assert_allclose(density_around(points, sizes, at, radius)[:, 0], weight.sum(1), atol=1e-12)
    assert cubic(np.array([0.0, 0.5, 1.0, 2.0])).tolist() == [1.0, 0.5, 0.0, 0.0]

    nothing = np.zeros((0, 2)), np.zeros(0)
    assert density_around(*nothing, np.ones((3, 1, 2)), np.ones(3)).tolist() == [[0.0]] * 3
    assert density_around(points, sizes, np.zeros((0, 2, 2)), np.zeros(0)).shape == (0, 2)

    groups, radius = rng.random((40, 1, 2)) * 100 + rng.normal(0, 4, (40, 8, 2)), rng.random(40) * 20 + 1
    single = density_around(points, sizes, groups.reshape(-1, 1, 2), np.repeat(radius, 8)).reshape(40, 8)
    np.testing.assert_array_equal(density_around(points, sizes, groups, radius), single)


def test_few_and_many_queries_get_the_bits_of_a_distance_map():
    for share in (0.0, 0.002, 0.1, 0.9, 1.0):
        rng = np.random.default_rng(3)
        mask = rng.random((40, 70)) < share
        x, y = rng.uniform(-100, 600, 5000), rng.uniform(-100, 400, 5000)
        distance = PaintedDistance(mask, 7.3)
        few = [PaintedDistance(mask, 7.3)(x[i : i + 9], y[i : i + 9]) for i in range(0, 5000, 9)]
        few = np.concatenate(few)
        assert few.tobytes() == distance(x, y).tobytes() == distance(x, y).tobytes()
        if not mask.any():
            assert np.isinf(few).all()
            continue
        inside = (x >= 0) & (x < 70 * 7.3) & (y > 0) & (y <= 40 * 7.3)
        exact = ndimage.distance_transform_edt(~mask)
        column, row = (x[inside] / 7.3).astype(int), (40 - y[inside] / 7.3).astype(int)
        np.testing.assert_allclose(few[inside], 7.3 * exact[row, column], rtol=1e-6)


def test_distances_outside_the_map_are_bounded_by_the_true_ones():
    painted = np.zeros((10, 20), bool)
    painted[2, 3] = True
    distance = PaintedDistance(painted, 10.0)
    x, y = np.array([35.0, 75.0, 35.0, -100.0, 35.0]), np.array([75.0, 75.0, 15.0, 75.0, 200.0])
    np.testing.assert_allclose(distance(x, y)[:3], [0.0, 40.0, 60.0])
    true = np.hypot(x - 35, y - 75)
    assert np.all(distance(x, y) <= true + 5.0)
    assert np.all(distance(x, y)[3:] > 100)
    assert np.isinf(PaintedDistance(~np.ones((4, 4), bool), 1.0)(x, y)).all()


def test_rounding_keeps_multiples_and_rounds_halves_one_way():
    number = np.arange(-5000, 5000)
    multiples, halves = number * STEP, (number + 0.5) * STEP
    np.testing.assert_array_equal(rounded(multiples), multiples)
    for nearly in (np.nextafter(halves, -np.inf), halves, np.nextafter(halves, np.inf)):
        np.testing.assert_array_equal(rounded(nearly), multiples)
    values = np.random.default_rng(1).uniform(-1e4, 1e4, 1000)
    assert np.abs(rounded(values) - values).max() < 0.54 * STEP


def test_the_blur_equals_scipys():
    values = np.random.default_rng(2).normal(size=(40, 60))
    for sigma in (0.001, 0.7, 3.0, 50.0):
        expected = ndimage.gaussian_filter(values, sigma, mode="nearest")
        np.testing.assert_allclose(gaussian_filter(values, sigma, axes=(0, 1)), expected, atol=1e-10)
        expected = ndimage.gaussian_filter1d(values, sigma, axis=0, mode="reflect", truncate=3.0)
        blurred = gaussian_filter(values, sigma, axes=(0,), mode="reflect", truncate=3.0)
        np.testing.assert_allclose(blurred, expected, atol=1e-10)
