"""Drafts: coarse changes on the ground as it was, shown while a stroke goes on."""

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import draft_recipe, evaluation
from sketchterrain.generation.terrain import Terrain
from sketchterrain.stages.runner import Results
from sketchterrain.terrain.layers.relief import ReliefLayer


def stroke(sketch, layer, row, column, radius):
    image = sketch.layers[layer].copy()
    rows, columns = np.indices(image.shape)
    image[np.hypot(rows - row, columns - column) < radius] = 1
    return sketch.replace(layers={**sketch.layers, layer: image})


@pytest.fixture(scope="module")
def built(valley):
    return valley.sketch, valley.memory, evaluation(valley.sketch, valley.memory), valley.recipe


def test_a_draft_has_the_new_mountain_and_the_rest_of_the_old_ground(built, context):
    sketch, memory, before, recipe = built
    side = sketch.width_px
    row, column, radius = round(0.88 * side), round(0.12 * side), round(0.06 * side)
    changed = stroke(sketch, "mountain", row, column, radius)
    plan = evaluation(changed, memory)
    draft = draft_recipe(plan, before)
    final = plan["recipe"]
    assert [type(each) for each in draft.layers] == [type(each) for each in final.layers]
    assert draft.rivers == recipe.rivers
    pixel = sketch.pixel_size
    x, y = np.meshgrid(
        (np.arange(128) + 0.5) * side * pixel / 128, (np.arange(128) + 0.5) * side * pixel / 128
    )
    old, quick, new = (
        Terrain(sketch, each, context).heights(x, y, cell_size=side * pixel / 128)
        for each in (recipe, draft, final)
    )
    away = np.hypot(x - (column + 0.5) * pixel, y - (sketch.height_px - row - 0.5) * pixel)
    inside, far = away < 0.7 * radius * pixel, away > 8 * radius * pixel
    raised, aimed = (quick - old)[inside].mean(), (new - old)[inside].mean()
    assert aimed > 100.0
    assert raised == pytest.approx(aimed, rel=0.3)
    assert (np.abs(quick - old)[far] > 0.0).mean() < 0.02


def test_a_draft_of_the_same_ground_is_none(built):
    sketch, memory, before, _ = built
    river = evaluation(stroke(sketch, "river", 20, 20, 4), memory)
    assert draft_recipe(river, before) is None
    for setting in ({"fidelity": 0.5}, {"extent": 2.0 * sketch.extent}):
        other = stroke(sketch, "mountain", 20, 20, 9).replace(**setting)
        assert draft_recipe(evaluation(other, memory), before) is None


def test_drafts_keep_all_that_did_not_change(built):
    sketch, memory, before, recipe = built
    plan = evaluation(stroke(sketch, "mountain", 40, 40, 12), memory)
    old, new = (each[ReliefLayer].painted.levels[0] for each in (recipe, draft_recipe(plan, before)))
    assert (new.column, new.row) == (old.column, old.row)
    np.testing.assert_array_equal(new.wetness, old.wetness)
    assert np.isnan(new.height).sum() == np.isnan(old.height).sum()
    assert (new.height == old.height).mean() > 0.5


def test_the_first_stroke_on_an_empty_sketch_has_a_draft(context):
    sketch, memory = Sketch(extent=2048.0, layers={"mountain": np.zeros((64, 64), np.uint8)}), Results()
    before = evaluation(sketch, memory)
    recipe = before["recipe"]
    changed = stroke(sketch, "mountain", 32, 32, 9)
    draft = draft_recipe(evaluation(changed, memory), before)
    flat, risen = (float(Terrain(sketch, each, context).heights(1024.0, 1024.0)) for each in (recipe, draft))
    assert risen > flat + 50.0
