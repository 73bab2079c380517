from __future__ import annotations

import numpy as np

from sketchterrain.features.hashing import hashed, smooth_noise, unit


def test_a_hash_depends_on_every_key_and_on_nothing_else() -> None:
    keys = np.arange(1000)
    first = hashed(7, "a", keys, 3)
    np.testing.assert_array_equal(first, hashed(7, "a", keys, 3))
    np.testing.assert_array_equal(first[500:], hashed(7, "a", keys[500:], 3))
    for other in (hashed(8, "a", keys, 3), hashed(7, "b", keys, 3), hashed(7, "a", keys, 4)):
        assert not np.any(first == other)
    keys = np.array([-1, 0, 1, -(2**62), 2**62], dtype=np.int64)
    assert len(np.unique(hashed(2**63 - 1, "a", keys))) == 5
    assert hashed(0, "a", -1) == hashed(0, "a", np.array(-1))


def test_unit_is_even_and_uncorrelated() -> None:
    values = unit(1, "even", np.arange(100_000))
    assert values.min() >= 0.0
    assert values.max() < 1.0
    counts = np.bincount((values * 20).astype(int), minlength=20)
    assert np.abs(counts - 5000).max() < 5 * np.sqrt(5000)
    values = values - 0.5
    assert abs(np.mean(values[1:] * values[:-1])) < 5 / 12 / np.sqrt(1e5)


def test_smooth_noise_is_smooth_and_bounded() -> None:
    x = np.linspace(-30.0, 30.0, 60_001)
    noise = smooth_noise(5, "n", x, np.full_like(x, 0.3))
    assert 0.0 <= noise.min() < 0.25
    assert 0.75 < noise.max() <= 1.0
    assert np.abs(np.diff(noise)).max() < 1.6e-3  # slope at most 1.5 a unit
