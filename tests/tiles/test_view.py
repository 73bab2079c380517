"""Views, metrics of detail and codes of tiles."""

from __future__ import annotations

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

KEYS = [TileKey(0, 0, 0), TileKey(-6, -3, 2), TileKey(9, 511, -512), TileKey(14, -(6 * 10**7), 6 * 10**7)]


def box(west, east, south, north, bottom, top):
    return Boxes(np.array([[west, south, bottom]], float), np.array([[east, north, top]], float))


def test_boxes_that_touch_the_frustum_are_inside():
    planes = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 10.0]])
    low = np.array([[-2.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [1.0, 0.0, 11.0]])
    high = np.array([[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [2.0, 1.0, 12.0]])
    assert inside_frustum(planes, low, high).tolist() == [False, True, False]


def test_a_moving_view_takes_its_planes_along():
    view = View((1.0, 2.0, 3.0), np.array([[1.0, 0.0, 0.0, -1.0]]), 500.0, velocity=(10.0, 0.0, -1.0))
    later = view.after(2.0)
    assert later.eye == (21.0, 2.0, 1.0)
    assert later.planes[0] @ [*later.eye, 1.0] == pytest.approx(view.planes[0] @ [*view.eye, 1.0])


def test_an_error_counts_by_its_distance_and_its_slant():
    view = View((0.0, 0.0, 0.0), np.zeros((0, 4)), 1000.0)
    level = box(100, 100, 0, 0, 0, 0)
    assert screen_errors(view, level, np.array([2.0])) == pytest.approx(20.0)
    below = box(0, 0, 0, 0, -100, -100)
    assert screen_errors(view, below, np.array([2.0])) == pytest.approx(0.0)
    slanting = box(100, 100, 0, 0, -100, -100)
    assert screen_errors(view, slanting, np.array([2.0])) == pytest.approx(10.0)


def test_metrics_measure_in_units_of_their_limits_and_refuse_invalid_ones():
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


def test_codes_name_places_and_their_neighbours():
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


def test_tiles_share_the_controls_where_they_touch():
    west, east, north = control_codes(codes_of([TileKey(2, -1, 5), TileKey(2, 0, 5), TileKey(2, -1, 6)]))
    assert (west[:, 2] == east[:, 0]).all()
    assert (west[0] == north[2]).all()
    assert len(np.unique([west, east, north])) == 27 - 6
