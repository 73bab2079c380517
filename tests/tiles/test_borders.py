from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.tiles import morph_weights, tile_indices
from sketchterrain.tiles.borders import EAST, NORTH, PARENT, SOUTH, WEST

ALL = [2, 4, 8, 64]


def triangles_of(quads, case):
    indices, first, count = tile_indices(quads)
    return indices[first[case] : first[case] + count[case]].reshape(-1, 3).astype(np.int64)


def places(triangles, quads):
    """x east and y north of the corners, in quads."""
    return triangles % (quads + 1), quads - triangles // (quads + 1)


@pytest.mark.parametrize("quads", ALL)
@pytest.mark.parametrize("case", range(16))
def test_triangles_fill_the_tile_once_and_face_up(quads, case):
    x, y = places(triangles_of(quads, case), quads)
    area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    assert (area > 0).all()
    assert area.sum() == 2 * quads**2


@pytest.mark.parametrize("quads", ALL)
@pytest.mark.parametrize("case", range(16))
def test_borders_have_every_vertex_or_every_other(quads, case):
    triangles = triangles_of(quads, case)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    inner = {tuple(edge[::-1]) for edge in edges.tolist()}
    open_ones = np.array([edge for edge in edges.tolist() if tuple(edge) not in inner])
    x, y = places(open_ones, quads)
    on = {
        NORTH: (y == quads).all(1),
        SOUTH: (y == 0).all(1),
        WEST: (x == 0).all(1),
        EAST: (x == quads).all(1),
    }
    assert sum(flags.sum() for flags in on.values()) == len(open_ones)
    for border, flags in on.items():
        length = np.abs(np.diff(x[flags], axis=1)) + np.abs(np.diff(y[flags], axis=1))
        assert (length == (2 if case & border else 1)).all()


@pytest.mark.parametrize("quads", ALL)
def test_a_tile_that_is_its_parent_has_a_quarter_of_the_triangles(quads):
    triangles = triangles_of(quads, PARENT)
    assert len(triangles) == quads**2 // 2
    x, y = places(triangles, quads)
    assert not (x % 2).any()
    assert not (y % 2).any()
    area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    assert (area == 4).all()


@pytest.mark.parametrize("case", [0, NORTH | EAST, SOUTH | WEST, NORTH | WEST, SOUTH | EAST])
def test_no_triangle_crosses_a_diagonal_of_the_parent(case):
    """So a tile that shows its parent's heights shows its parent's very surface."""
    quads = 8
    x, y = places(triangles_of(quads, case), quads)
    # Twice the middle of each triangle, and its corners, from the north-west of the parent's quad it lies in.
    column, row = (x.sum(axis=1) // 6, (3 * quads - y.sum(axis=1)) // 6)
    east, south = x - 2 * column[:, None], quads - y - 2 * row[:, None]
    assert (((east >= south).all(axis=1)) | ((east <= south).all(axis=1))).all()
    assert (east.min() >= 0) & (south.min() >= 0) & (east.max() <= 2) & (south.max() <= 2)


@pytest.mark.parametrize("quads", [0, 1, 7])
def test_quads_must_be_even(quads):
    with pytest.raises(InputError, match="even number"):
        tile_indices(quads)


def test_weights_are_the_controls_where_those_stand_and_exact_on_borders():
    controls = np.random.default_rng(5).random((40, 3, 3)).astype(np.float32)
    controls[:20, :, 0] = 1.0
    weights = morph_weights(controls, 64)
    assert (weights[:, ::32, ::32] == controls).all()
    assert (weights[:20, :, 0] == 1.0).all()
    other = morph_weights(controls[:, :, ::-1].copy(), 64)
    assert (other[:, :, 64] == weights[:, :, 0]).all(), "both sides of a border compute the same bits"
    assert ((weights >= 0) & (weights <= 1)).all()
    assert np.abs(np.diff(weights, axis=2)).max() <= 1 / 16 + 1e-6
