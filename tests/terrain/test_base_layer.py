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
from sketchterrain.terrain.changes import difference
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.layers import base as base_layer
from sketchterrain.terrain.layers.base import BaseLayer
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.recipe import TerrainRecipe

from .conftest import Waves, base_of, grid_of, small_base

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


def test_bits_depend_neither_on_launches_nor_on_slots(recipe, context, monkeypatch) -> None:
    whole, bounds = Evaluator(recipe, context).tiles(KEYS, LEVEL)
    monkeypatch.setattr(base_layer, "SLOTS", 6)
    few = Evaluator(recipe, context)
    for start in range(0, len(KEYS), 8):
        part, own = few.tiles(KEYS[start : start + 8], LEVEL)
        assert np.array_equal(part.ground, whole.ground[start : start + 8])
        assert np.array_equal(own, bounds[start : start + 8])


def test_bits_do_not_depend_on_the_order_of_grids(recipe, context, base) -> None:
    parts = list(base.patchwork.grids.values())
    turned = Patchwork({each.id: each for each in parts[1::-1]})
    other = replace(base, patchwork=turned)
    changed = recipe.with_layers([BaseLayer.of(other, 1.0)])
    x, y = np.random.default_rng(1).integers(0, 1 << 24, (2, 3000))
    for cell in (0.0, 60.0, 200.0):
        one, two = (Evaluator(each, context).points(x, y, cell_size=cell)[0] for each in (recipe, changed))
        assert one.tobytes() == two.tobytes()


def test_tiles_meet_and_equal_points(recipe, context) -> None:
    surface, _ = Evaluator(recipe, context).tiles([(3, 3), (4, 3)], LEVEL)
    west, east = surface.height
    assert np.array_equal(west[:, -1], east[:, 0])
    side = (1 << 24) >> LEVEL
    at = 3 * side + np.arange(65) * (side >> 6)
    x, y = (each.ravel() for each in np.meshgrid(at, at[::-1]))
    cell = 4096.0 / (64 << LEVEL)
    height, _ = Evaluator(recipe, context).points(x, y, cell_size=cell)
    assert np.array_equal(height.reshape(65, 65), west)


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
    evaluator = Evaluator(recipe, context)
    for level, wide in ((1, 2), (3, 6), (5, 4)):
        keys = [(column, row) for column in range(wide) for row in range(wide)]
        surface, bounds = evaluator.tiles(keys, level)
        side = (1 << 24) >> level
        step = np.arange(65) * (side >> 6)
        for (column, row), own, bound in zip(keys, surface.height, bounds, strict=True):
            x, y = (each.ravel() for each in np.meshgrid(column * side + step, row * side + step[::-1]))
            full, _ = evaluator.points(x, y, cell_size=0.0)
            assert np.abs(own.ravel() - full).max() <= bound + 1e-3, (level, column, row)


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
