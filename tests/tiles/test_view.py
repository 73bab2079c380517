"""Views, metrics of detail, codes of tiles, and what batches of them cost."""

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.tiles import QuadLength, ScreenError, View, inside_frustum
from sketchterrain.tiles.codes import (
    AROUND,
    Boxes,
    TileKey,
    around,
    children_of,
    codes_of,
    control_codes,
    keys_of,
    neighbours_of,
    parent_of,
    parents_around,
)
from sketchterrain.tiles.metrics import screen_errors
from sketchterrain.tiles.schedule import CostModel

KEYS = [TileKey(0, 0, 0), TileKey(-6, -3, 2), TileKey(9, 511, -512), TileKey(14, -(6 * 10**7), 6 * 10**7)]


def box(west, east, south, north, bottom, top):
    return Boxes(np.array([[west, south, bottom]], float), np.array([[east, north, top]], float))


def test_frusta_hold_what_touches_them_and_move_with_their_view():
    planes = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 10.0]])
    low = np.array([[-2.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [1.0, 0.0, 11.0]])
    high = np.array([[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [2.0, 1.0, 12.0]])
    assert inside_frustum(planes, low, high).tolist() == [False, True, False]

    view = View((1.0, 2.0, 3.0), np.array([[1.0, 0.0, 0.0, -1.0]]), 500.0, velocity=(10.0, 0.0, -1.0))
    later = view.after(2.0)
    assert later.eye == (21.0, 2.0, 1.0)
    assert later.planes[0] @ [*later.eye, 1.0] == pytest.approx(view.planes[0] @ [*view.eye, 1.0])


def test_metrics_count_distance_and_slant_in_units_of_their_limits():
    view = View((0.0, 0.0, 0.0), np.zeros((0, 4)), 1000.0)
    level = box(100, 100, 0, 0, 0, 0)
    assert screen_errors(view, level, np.array([2.0])) == pytest.approx(20.0)
    below = box(0, 0, 0, 0, -100, -100)
    assert screen_errors(view, below, np.array([2.0])) == pytest.approx(0.0)
    slanting = box(100, 100, 0, 0, -100, -100)
    assert screen_errors(view, slanting, np.array([2.0])) == pytest.approx(10.0)

    view = View((0.0, 0.0, 0.0), np.zeros((0, 4)), 1000.0)
    far = box(400, 400, 0, 0, 0, 0)
    errors, cells = np.array([1.0]), np.array([8.0])
    assert ScreenError(2.5, quad=1e9).excess(view, far, errors, cells) == pytest.approx(1.0)
    assert ScreenError(1e9, quad=20.0).excess(view, far, errors, cells) == pytest.approx(1.0)
    assert QuadLength(2.5).excess(view, far, errors, cells) == pytest.approx(1.0)
    for metric in (ScreenError(), QuadLength()):
        twice = metric.coarser(2.0).excess(view, far, errors, cells)
        assert twice == pytest.approx(metric.excess(view, far, errors, cells) / 2)
    for metric, options in (
        (ScreenError, {"tolerance": 0.0}),
        (ScreenError, {"quad": -1.0}),
        (QuadLength, {"factor": 0.0}),
    ):
        with pytest.raises(InputError, match="expected"):
            metric(**options)


def test_codes_name_places_their_neighbours_and_shared_controls():
    codes = codes_of(KEYS)
    assert keys_of(codes) == KEYS
    assert keys_of(parent_of(codes)) == [TileKey(k.level - 1, k.col >> 1, k.row >> 1) for k in KEYS]
    for key, children, beside in zip(KEYS, children_of(codes), neighbours_of(codes), strict=True):
        assert (parent_of(children) == codes_of([key])).all()
        assert keys_of(children)[1] == TileKey(key.level + 1, 2 * key.col + 1, 2 * key.row)
        assert keys_of(beside) == [TileKey(key.level, key.col + x, key.row + y) for x, y in AROUND]

    everywhere = (-(1 << 40), 1 << 40, -(1 << 40), 1 << 40)
    for code in codes_of(KEYS):
        one = np.array([code])
        assert around(int(code), everywhere) == neighbours_of(one)[0].tolist()
        parents = np.unique(parent_of(np.append(neighbours_of(one), one)))
        assert sorted(parents_around(int(code), everywhere)) == parents.tolist()
    assert around(int(codes_of([TileKey(3, 4, 4)])[0]), (4, 4, 4, 4)) == []

    west, east, north = control_codes(codes_of([TileKey(2, -1, 5), TileKey(2, 0, 5), TileKey(2, -1, 6)]))
    assert (west[:, 2] == east[:, 0]).all()
    assert (west[0] == north[2]).all()
    assert len(np.unique([west, east, north])) == 27 - 6


def learnt(batch, level, tile, *, noise=0.0, rounds=100, mixed=True):
    """A model that has seen batches that take `batch` s and so much for each level and tile."""
    rng = np.random.default_rng(4)
    model = CostModel()
    for _ in range(rounds):
        levels = rng.integers(0, 3, rng.integers(1, 12) if mixed else 1)
        seconds = batch + level * len(np.unique(levels)) + tile * len(levels)
        model.learn(levels, seconds * (1.0 + noise * rng.random()))
    return model


def test_levels_and_tiles_are_told_apart_and_planned_batches_fit():
    model = learnt(0.0, 0.003, 0.0002)
    assert model.expected(np.zeros(1)) == pytest.approx(0.0032, rel=0.1)
    assert model.expected(np.zeros(10)) == pytest.approx(0.005, rel=0.1)
    # Four fifths of a budget are planned with.
    assert model.fitting(np.zeros(64), 0.007 / 0.8) == pytest.approx(20, abs=3)

    model = learnt(0.001, 0.002, 0.0004, noise=0.3)
    levels = np.zeros(64, np.int64)
    count = model.fitting(levels, 0.01)
    assert 8 <= count <= 17
    assert 1.3 * (0.003 + 0.0004 * count) <= 0.0105

    model = learnt(0.0, 0.0025, 0.0003, mixed=False)
    assert model.expected(np.zeros(1)) == pytest.approx(0.0028, rel=0.02)
    assert model.fitting(np.zeros(64), 0.007) > 2


def test_old_and_wide_tiles_make_no_others_dear_and_one_is_always_made():
    model = learnt(0.0, 0.003, 0.002)
    for _ in range(80):
        model.learn(np.array([1, 1, 2]), 0.0007)
    assert model.expected(np.array([1, 1, 2])) == pytest.approx(0.0007, rel=0.1)

    model = learnt(0.0, 1.0, 1.0)
    assert model.fitting(np.zeros(5), 1e-6) == 1
    assert model.fitting(np.zeros(5), 0.0) == 0
    assert model.fitting(np.zeros(0), 1.0) == 0
    assert model.fitting(np.zeros(5), np.inf) == 5
    with pytest.raises(InputError, match="budget"):
        model.fitting(np.zeros(5), -1.0)

    rng = np.random.default_rng(4)
    model = CostModel()
    for wide in (True, False) * 40:
        levels = rng.integers(-5, -2, 4) if wide else rng.integers(0, 3, rng.integers(1, 12))
        model.learn(levels, 0.001 + 0.0004 * len(levels) + 0.006 * 4 * wide)
    assert model.expected(np.full(5, -4)) == pytest.approx(0.033, rel=0.15)
    assert model.expected(np.zeros(10)) == pytest.approx(0.005, rel=0.15)
    assert model.fitting(np.full(20, -4), 0.02) in (2, 3)
    assert model.fitting(np.zeros(64), 0.007) >= 10
