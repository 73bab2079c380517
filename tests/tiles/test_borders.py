import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.tiles import morph_weights, tile_indices
from sketchterrain.tiles.borders import EAST, NORTH, PARENT, SOUTH, WEST

QUADS = (2, 4, 8, 64)


def triangles_of(quads, case):
    indices, first, count = tile_indices(quads)
    return indices[first[case] : first[case] + count[case]].reshape(-1, 3).astype(np.int64)


def places(triangles, quads):
    """x east and y north of the corners, in quads."""
    return triangles % (quads + 1), quads - triangles // (quads + 1)


def doubled_areas(x, y):
    return (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])


def test_triangles_of_each_case_fill_the_tile_once_and_drop_vertices_on_coarser_borders():
    for quads, case in ((quads, case) for quads in QUADS for case in range(16)):
        name = f"{quads} quads, case {case}"
        triangles = triangles_of(quads, case)
        areas = doubled_areas(*places(triangles, quads))
        assert (areas > 0).all(), name
        assert areas.sum() == 2 * quads**2, name
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        forward, backward = edges @ [1 << 32, 1], edges @ [1, 1 << 32]
        x, y = places(edges[~np.isin(forward, backward)], quads)
        on = {
            NORTH: (y == quads).all(1),
            SOUTH: (y == 0).all(1),
            WEST: (x == 0).all(1),
            EAST: (x == quads).all(1),
        }
        assert sum(flags.sum() for flags in on.values()) == len(x), name
        for border, flags in on.items():
            length = np.abs(np.diff(x[flags], axis=1)) + np.abs(np.diff(y[flags], axis=1))
            assert (length == (2 if case & border else 1)).all(), name


def test_a_tile_that_shows_its_parent_has_its_parents_very_surface():
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


def test_odd_numbers_of_quads_are_refused():
    for quads in (0, 1, 7):
        with pytest.raises(InputError, match="even number"):
            tile_indices(quads)


def test_morph_weights_equal_the_controls_at_their_places_and_agree_on_borders():
    controls = np.random.default_rng(5).random((40, 3, 3)).astype(np.float32)
    controls[:20, :, 0] = 1.0
    weights = morph_weights(controls, 64)
    assert (weights[:, ::32, ::32] == controls).all()
    assert (weights[:20, :, 0] == 1.0).all()
    other = morph_weights(controls[:, :, ::-1].copy(), 64)
    assert (other[:, :, 64] == weights[:, :, 0]).all(), "both sides of a border compute the same bits"
    assert ((weights >= 0) & (weights <= 1)).all()
    assert np.abs(np.diff(weights, axis=2)).max() <= 1 / 16 + 1e-6
