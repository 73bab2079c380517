"""Views, borders, horizon, metrics of detail, codes of tiles, and what batches of them cost."""

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.tiles.lod import (
    CameraView,
    ScreenError,
    inside_frustum,
    morph_weights,
    occluded,
    screen_errors,
)
from sketchterrain.tiles.quadtree import (
    AROUND,
    EAST,
    NORTH,
    PARENT,
    SOUTH,
    WEST,
    Boxes,
    TileKey,
    around,
    children_of,
    control_codes,
    keys_of,
    neighbours_of,
    parent_of,
    parents_around,
    tile_indices,
)
from sketchterrain.tiles.stream import CostModel

from .conftest import codes_of

KEYS = [TileKey(0, 0, 0), TileKey(-6, -3, 2), TileKey(9, 511, -512), TileKey(14, -(6 * 10**7), 6 * 10**7)]


def boxes(*sides):
    """Boxes from west, east, south, north, bottom and top."""
    west, east, south, north, bottom, top = np.array(sides, np.float64).T
    return Boxes(np.stack([west, south, bottom], -1), np.stack([east, north, top], -1))


def test_frusta_contain_touching_boxes_and_move_with_the_view():
    planes = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 10.0]])
    low = np.array([[-2.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [1.0, 0.0, 11.0]])
    high = np.array([[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [2.0, 1.0, 12.0]])
    assert inside_frustum(planes, low, high).tolist() == [False, True, False]

    view = CameraView((1.0, 2.0, 3.0), np.array([[1.0, 0.0, 0.0, -1.0]]), 500.0, velocity=(10.0, 0.0, -1.0))
    later = view.extrapolated(2.0)
    assert later.eye == (21.0, 2.0, 1.0)
    assert later.planes[0] @ [*later.eye, 1.0] == pytest.approx(view.planes[0] @ [*view.eye, 1.0])


def test_metrics_count_distance_and_slant_in_units_of_their_limits():
    view = CameraView((0.0, 0.0, 0.0), np.zeros((0, 4)), 1000.0)
    level = boxes((100, 100, 0, 0, 0, 0))
    assert screen_errors(view, level, np.array([2.0])) == pytest.approx(20.0)
    below = boxes((0, 0, 0, 0, -100, -100))
    assert screen_errors(view, below, np.array([2.0])) == pytest.approx(0.0)
    slanting = boxes((100, 100, 0, 0, -100, -100))
    assert screen_errors(view, slanting, np.array([2.0])) == pytest.approx(10.0)

    far = boxes((400, 400, 0, 0, 0, 0))
    errors, cells = np.array([1.0]), np.array([8.0])
    assert ScreenError(2.5, quad=1e9).excess(view, far, errors, cells) == pytest.approx(1.0)
    assert ScreenError(1e9, quad=20.0).excess(view, far, errors, cells) == pytest.approx(1.0)
    hazy = ScreenError(2.5, quad=1e9, extinction=0.01).excess(view, far, errors, cells)
    assert hazy == pytest.approx(np.exp(-4.0))
    twice = ScreenError().relaxed(2.0).excess(view, far, errors, cells)
    assert twice == pytest.approx(ScreenError().excess(view, far, errors, cells) / 2)
    for option in ({"tolerance": 0}, {"quad": -1}):
        with pytest.raises(InputError, match="expected"):
            ScreenError(**option)


def test_codes_round_trip_with_neighbours_and_shared_controls():
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


def fitted_model(batch, level, tile, *, noise=0.0, rounds=100, mixed=True):
    """Cost model of batches that take `batch` s, `level` s per level and `tile` s per tile."""
    rng = np.random.default_rng(4)
    model = CostModel()
    for _ in range(rounds):
        levels = rng.integers(0, 3, rng.integers(1, 12) if mixed else 1)
        seconds = batch + level * len(np.unique(levels)) + tile * len(levels)
        model.record(levels, seconds * (1.0 + noise * rng.random()))
    return model


def test_costs_of_levels_and_tiles_are_separated_and_batches_fit():
    model = fitted_model(0.0, 0.003, 0.0002)
    assert model.expected(np.zeros(1)) == pytest.approx(0.0032, rel=0.1)
    assert model.expected(np.zeros(10)) == pytest.approx(0.005, rel=0.1)
    # Four fifths of a budget are planned with.
    assert model.count_within(np.zeros(64), 0.007 / 0.8) == pytest.approx(20, abs=3)

    model = fitted_model(0.001, 0.002, 0.0004, noise=0.3)
    levels = np.zeros(64, np.int64)
    count = model.count_within(levels, 0.01)
    assert 8 <= count <= 17
    assert 1.3 * (0.003 + 0.0004 * count) <= 0.0105

    model = fitted_model(0.0, 0.0025, 0.0003, mixed=False)
    assert model.expected(np.zeros(1)) == pytest.approx(0.0028, rel=0.02)
    assert model.count_within(np.zeros(64), 0.007) > 2


def test_old_and_wide_tiles_do_not_affect_others_and_one_always_fits():
    model = fitted_model(0.0, 0.003, 0.002)
    for _ in range(80):
        model.record(np.array([1, 1, 2]), 0.0007)
    assert model.expected(np.array([1, 1, 2])) == pytest.approx(0.0007, rel=0.1)

    model = fitted_model(0.0, 1.0, 1.0)
    assert model.count_within(np.zeros(5), 1e-6) == 1
    assert model.count_within(np.zeros(5), 0.0) == 0
    assert model.count_within(np.zeros(0), 1.0) == 0
    assert model.count_within(np.zeros(5), np.inf) == 5
    with pytest.raises(InputError, match="budget"):
        model.count_within(np.zeros(5), -1.0)

    rng = np.random.default_rng(4)
    model = CostModel()
    for wide in (True, False) * 40:
        levels = rng.integers(-5, -2, 4) if wide else rng.integers(0, 3, rng.integers(1, 12))
        model.record(levels, 0.001 + 0.0004 * len(levels) + 0.006 * 4 * wide)
    assert model.expected(np.full(5, -4)) == pytest.approx(0.033, rel=0.15)
    assert model.expected(np.zeros(10)) == pytest.approx(0.005, rel=0.15)
    assert model.count_within(np.full(20, -4), 0.02) in (2, 3)
    assert model.count_within(np.zeros(64), 0.007) >= 10


QUADS = (2, 4, 8, 64)


def triangles_of(quads, case):
    indices, first, count = tile_indices(quads)
    return indices[first[case] : first[case] + count[case]].reshape(-1, 3).astype(np.int64)


def places(triangles, quads):
    """x east and y north of the corners, in quads."""
    return triangles % (quads + 1), quads - triangles // (quads + 1)


def doubled_areas(x, y):
    return (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])


def test_triangles_of_each_case_cover_the_tile_once():
    for quads, case in ((quads, case) for quads in QUADS for case in range(16)):
        name = f"{quads} quads, case {case}"
        triangles = triangles_of(quads, case)
        areas = doubled_areas(*places(triangles, quads))
        assert (areas > 0).all(), name
        assert areas.sum() == 2 * quads**2, name
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        forward, backward = edges @ [1 << 32, 1], edges @ [1, 1 << 32]
        x, y = places(edges[~np.isin(forward, backward)], quads)
        sides = (NORTH, y == quads), (SOUTH, y == 0), (WEST, x == 0), (EAST, x == quads)
        on = {border: flags.all(1) for border, flags in sides}
        assert sum(flags.sum() for flags in on.values()) == len(x), name
        for border, flags in on.items():
            length = np.abs(np.diff(x[flags], axis=1)) + np.abs(np.diff(y[flags], axis=1))
            assert (length == (2 if case & border else 1)).all(), name


def test_a_tile_that_shows_its_parent_has_the_parents_surface():
    for quads in QUADS:
        triangles = triangles_of(quads, PARENT)
        assert len(triangles) == quads**2 // 2
        x, y = places(triangles, quads)
        assert not (x % 2).any()
        assert not (y % 2).any()
        assert (doubled_areas(x, y) == 4).all()

    # So a tile that shows its parent's heights shows its parent's very surface.
    quads = 8
    for case in (0, NORTH | EAST, SOUTH | WEST, NORTH | WEST, SOUTH | EAST):
        x, y = places(triangles_of(quads, case), quads)
        # Twice the middle of each triangle, and its corners, from the north-west of the parent's quad.
        column, row = (x.sum(axis=1) // 6, (3 * quads - y.sum(axis=1)) // 6)
        east, south = x - 2 * column[:, None], quads - y - 2 * row[:, None]
        assert (((east >= south).all(axis=1)) | ((east <= south).all(axis=1))).all(), case
        assert (east.min() >= 0) & (south.min() >= 0) & (east.max() <= 2) & (south.max() <= 2), case
    for quads in (0, 1, 7):
        with pytest.raises(InputError, match="even number"):
            tile_indices(quads)


def test_morph_weights_interpolate_controls_and_agree_on_borders():
    controls = np.random.default_rng(5).random((40, 3, 3)).astype(np.float32)
    controls[:20, :, 0] = 1.0
    weights = morph_weights(controls, 64)
    assert (weights[:, ::32, ::32] == controls).all()
    assert (weights[:20, :, 0] == 1.0).all()
    other = morph_weights(controls[:, :, ::-1].copy(), 64)
    assert (other[:, :, 64] == weights[:, :, 0]).all(), "both sides of a border compute the same bits"
    assert ((weights >= 0) & (weights <= 1)).all()
    assert np.abs(np.diff(weights, axis=2)).max() <= 1 / 16 + 1e-6


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


def test_only_boxes_wholly_behind_nearer_terrain_are_occluded():
    for name, (height, ground, hidden) in CASES.items():
        view = CameraView((0.0, 0.0, height), np.zeros((0, 4)), 1000.0)
        assert occluded(view, boxes(*ground)).tolist() == hidden, name


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, 6))])
def test_no_ray_reaches_an_occluded_box(seed):
    """Rays from the eye to the tops of occluded columns on a grid all pass through another column."""
    rng = np.random.default_rng(seed)
    width, n = 50.0, 24
    col, row = np.meshgrid(np.arange(-n, n), np.arange(-n, n))
    west, south = col.ravel() * width, row.ravel() * width
    bottom = 40.0 * rng.random(west.size) ** 3
    top = bottom + 10.0 * rng.random(west.size)
    eye = np.array([rng.uniform(-20, 20), rng.uniform(-20, 20), 30.0])
    ground = boxes(*zip(west, west + width, south, south + width, bottom, top, strict=True))
    hidden = occluded(CameraView(tuple(eye), np.zeros((0, 4)), 1000.0), ground)
    assert hidden.sum() > 20
    along = np.linspace(0.0, 1.0, 4000)[1:-1]
    for index in rng.choice(np.flatnonzero(hidden), 20, replace=False):
        x, y = west[index] + rng.random() * width, south[index] + rng.random() * width
        target = np.array([x, y, top[index]])
        ray = eye + along[:, None] * (target - eye)
        i = ((ray[:, 1] // width + n) * 2 * n + ray[:, 0] // width + n).astype(int)
        assert ((ray[:, 2] < bottom[i]) & (i != index)).any()
