"""Elevation data as a layer: bits that depend on nothing but the data, bounds, and the rim."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.elevation.base import BaseElevation
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.landforms.base_ground import BaseGround
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.layers import base as base_layer
from sketchterrain.terrain.layers.base import BaseLayer
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.recipe import TerrainRecipe, difference

from .conftest import Waves, assert_bounds_hold, assert_tiles_meet, base_of, grid_of, small_base

LEVEL, KEYS = 3, [(column, row) for column in range(8) for row in range(8)]


@pytest.fixture(scope="module")
def base() -> BaseElevation:
    return small_base()


@pytest.fixture
def recipe(make_recipe, base) -> TerrainRecipe:
    return make_recipe(relief=ReliefLayer(Waves(), base=BaseGround(base, 16.0, Waves())))


def test_samples_are_kept(make_recipe, context) -> None:
    grid = grid_of(30.0, 130, 100.0, 100.0, 0.0)
    recipe = make_recipe(
        relief=ReliefLayer(Waves(), base=BaseGround(base_of(grid), 16.0, Waves())), detail=0.0
    )
    row, column = np.mgrid[20:110:3, 20:110:3]
    x, y = (to_lattice(each.ravel(), 4096.0) for each in grid.to_metres(column * 1.0, row * 1.0))
    height, _ = Evaluator(recipe, context).points(x, y, cell_size=0.0)
    assert np.abs(height - grid.samples[row, column].ravel()).max() <= 1e-3


def test_tiles_meet_and_equal_points_whatever_the_launches_and_slots(recipe, context, monkeypatch) -> None:
    whole = Evaluator(recipe, context)
    whole.tiles(KEYS, LEVEL)
    monkeypatch.setattr(base_layer, "SLOTS", 6)
    assert_tiles_meet(whole, LEVEL, KEYS, Evaluator(recipe, context))


def test_bits_do_not_depend_on_the_order_of_grids(recipe, context, base) -> None:
    parts = list(base.patchwork.grids.values())
    turned = Patchwork({each.id: each for each in parts[1::-1]})
    other = replace(base, patchwork=turned)
    changed = recipe.with_layers([BaseLayer.of(other, 1.0)])
    x, y = np.random.default_rng(1).integers(0, 1 << 24, (2, 3000))
    for cell in (0.0, 60.0, 200.0):
        one, two = (Evaluator(each, context).points(x, y, cell_size=cell)[0] for each in (recipe, changed))
        assert one.tobytes() == two.tobytes()


def test_there_is_no_step_where_the_data_end(recipe, context, base) -> None:
    """The drop from sample to sample is that of slopes, along lines across the rims and into the void."""
    recipe = recipe.with_layers([BaseLayer(base)])  # without detail
    along = np.arange(-(1 << 22), 5 << 22, 1 << 12)
    for across in (0.3, 0.62, 0.8):
        height, _ = Evaluator(recipe, context).points(
            along, np.full(len(along), int(across * (1 << 24))), cell_size=0.0
        )
        assert np.abs(np.diff(height)).max() < 3.0 * 4096.0 / (1 << 12)
    beyond = np.random.default_rng(2).integers(-(1 << 24), -(1 << 22), (2, 500))
    there = recipe.with_layers([BaseLayer()])
    one, two = (Evaluator(each, context).points(*beyond, cell_size=0.0)[0] for each in (recipe, there))
    assert np.array_equal(one, two)


def test_bounds_hold_of_what_a_cell_size_omits(recipe, context) -> None:
    for level, wide in ((1, 2), (3, 6), (5, 4)):
        keys = [(column, row) for column in range(wide) for row in range(wide)]
        assert_bounds_hold(Evaluator(recipe, context), level, keys)


def test_other_data_change_everything(recipe, base) -> None:
    other = base_of(grid_of(30.0, 110, 100.0, 200.0, 0.0))
    changed = recipe.with_layers(
        [BaseLayer(other), ReliefLayer(Waves(), base=BaseGround(other, 16.0, Waves()))]
    )
    assert difference(recipe, changed) is None
    same = BaseGround(replace(base, findings=("again",)), 16.0, Waves())
    change = difference(recipe, recipe.with_layers([ReliefLayer(Waves(), base=same)]))
    assert change is not None
    assert not change.areas


def test_data_smaller_than_a_node_are_left_out(make_recipe, context) -> None:
    tiny = base_of(grid_of(0.5, 20, 2000.0, 2000.0, 0.0), margin=4.0)
    assert len(build_patches(grid_of(0.5, 20, 2000.0, 2000.0, 0.0)))
    recipe = make_recipe(relief=ReliefLayer(Waves(), base=BaseGround(tiny, 16.0, Waves())))
    x, y = np.random.default_rng(2).integers(0, 1 << 24, (2, 500))
    height, _ = Evaluator(recipe, context).points(x, y, cell_size=0.0)
    assert np.isfinite(height).all()


def test_recipes_with_data_are_sent_to_other_processes(recipe, context) -> None:
    sent = copy.deepcopy(recipe)  # as pickles are made
    assert sent.key() == recipe.key()
    x, y = np.random.default_rng(3).integers(0, 1 << 24, (2, 500))
    one, two = (Evaluator(each, context).points(x, y, cell_size=30.0)[0] for each in (recipe, sent))
    assert np.array_equal(one, two)
