"""Rivers and lakes as triangles: on their levels, within the ground, never two in one plane."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.export.mesh_vertices import waters
from sketchterrain.export.sampled import Grid

GRID = Grid(0.0, 0.0, 400.0, 400.0, 41, 41)
LEVEL = 20.0


def river(number, points, width):
    line = np.asarray(points, np.float64)
    return SimpleNamespace(id=number, centreline=line, centreline_width=np.full(len(line), width, np.float32))


def lake(number, centre, radius):
    y, x = np.mgrid[0.0:401.0:4.0, 0.0:401.0:4.0]
    inside = (radius - np.hypot(x - centre[0], y - centre[1])).astype(np.float32)
    field = SimpleNamespace(west=0.0, south=0.0, spacing=4.0, inside=inside)
    return SimpleNamespace(id=number, shape=field, level=LEVEL)


@pytest.fixture(scope="module")
def found():
    x = np.linspace(-60.0, 250.0, 80)
    line = np.stack([x, np.full(80, 200.0), np.maximum(LEVEL, 32.0 - 0.08 * x)], axis=-1)
    features = SimpleNamespace(lakes=[lake(3, (250.0, 200.0), 90.0)], rivers=[river(7, line, 16.0)])
    return {water.name: water for water in waters(features, GRID)}


def areas(water):
    a, b, c = (water.place[water.triangles[:, k], :2] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def test_each_has_its_name_and_faces_up(found):
    assert list(found) == ["lake 3", "river 7"]
    for water in found.values():
        assert (areas(water) > 0.0).all()
        assert set(water.triangles.ravel().tolist()) == set(range(len(water.place)))


def test_a_lake_is_level_and_as_large_as_it_is(found):
    water = found["lake 3"]
    assert (water.place[:, 2] == LEVEL).all()
    assert 90.0**2 < areas(water).sum() / np.pi < 96.0**2  # it ends within its banks


def test_a_river_ends_at_the_grids_edge_and_in_the_lake_below_its_level(found):
    place = found["river 7"].place
    assert place[:, 0].min() == 0.0
    assert place[:, 0].max() < 250.0 - 90.0 + 20.0
    wet = np.hypot(place[:, 0] - 250.0, place[:, 1] - 200.0) < 90.0 - 1.0
    assert wet.any()
    assert (place[wet, 2] < LEVEL - 0.02).all()
    assert (place[~wet, 2] > LEVEL - 0.05).all()


def test_what_lies_beside_the_grid_is_left_out():
    line = np.stack([np.linspace(0.0, 300.0, 40), np.full(40, 900.0), np.full(40, 5.0)], axis=-1)
    assert not list(waters(SimpleNamespace(lakes=[], rivers=[river(1, line, 8.0)]), GRID))
