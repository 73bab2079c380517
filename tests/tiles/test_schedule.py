from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.tiles.schedule import CostModel


def learnt(batch, level, tile, *, noise=0.0, rounds=100, mixed=True):
    """A model that has seen batches that take `batch` s and so much for each level and tile."""
    rng = np.random.default_rng(4)
    model = CostModel()
    for _ in range(rounds):
        levels = rng.integers(0, 3, rng.integers(1, 12) if mixed else 1)
        seconds = batch + level * len(np.unique(levels)) + tile * len(levels)
        model.learn(levels, seconds * (1.0 + noise * rng.random()))
    return model


def test_levels_and_tiles_are_told_apart():
    model = learnt(0.0, 0.003, 0.0002)
    assert model.expected(np.zeros(1)) == pytest.approx(0.0032, rel=0.1)
    assert model.expected(np.zeros(10)) == pytest.approx(0.005, rel=0.1)
    # Four fifths of a budget are planned with.
    assert model.fitting(np.zeros(64), 0.007 / 0.8) == pytest.approx(20, abs=3)


def test_a_batch_that_was_planned_fits():
    model = learnt(0.001, 0.002, 0.0004, noise=0.3)
    levels = np.zeros(64, np.int64)
    count = model.fitting(levels, 0.01)
    assert 8 <= count <= 17
    assert 1.3 * (0.003 + 0.0004 * count) <= 0.0105


def test_single_tiles_do_not_hide_that_two_would_fit():
    model = learnt(0.0, 0.0025, 0.0003, mixed=False)
    assert model.expected(np.zeros(1)) == pytest.approx(0.0028, rel=0.02)
    assert model.fitting(np.zeros(64), 0.007) > 2


def test_what_is_long_ago_is_forgotten():
    model = learnt(0.0, 0.003, 0.002)
    for _ in range(80):
        model.learn(np.array([1, 1, 2]), 0.0007)
    assert model.expected(np.array([1, 1, 2])) == pytest.approx(0.0007, rel=0.1)


def test_one_tile_is_made_whatever_it_takes_and_none_without_time():
    model = learnt(0.0, 1.0, 1.0)
    assert model.fitting(np.zeros(5), 1e-6) == 1
    assert model.fitting(np.zeros(5), 0.0) == 0
    assert model.fitting(np.zeros(0), 1.0) == 0
    assert model.fitting(np.zeros(5), np.inf) == 5
    with pytest.raises(InputError, match="budget"):
        model.fitting(np.zeros(5), -1.0)


def test_wide_tiles_are_dearer_and_make_no_others_dear():
    rng = np.random.default_rng(4)
    model = CostModel()
    for wide in (True, False) * 40:
        levels = rng.integers(-5, -2, 4) if wide else rng.integers(0, 3, rng.integers(1, 12))
        model.learn(levels, 0.001 + 0.0004 * len(levels) + 0.006 * 4 * wide)
    assert model.expected(np.full(5, -4)) == pytest.approx(0.033, rel=0.15)
    assert model.expected(np.zeros(10)) == pytest.approx(0.005, rel=0.15)
    assert model.fitting(np.full(20, -4), 0.02) in (2, 3)
    assert model.fitting(np.zeros(64), 0.007) >= 10
