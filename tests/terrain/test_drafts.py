"""Drafts: coarse changes on the ground as it was, shown while a stroke goes on."""

import numpy as np
import pytest
import shapely

from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import FeatureTable
from sketchterrain.generation.building import draft_recipes, evaluation
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
    draft = next(draft_recipes(plan, before))
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


@pytest.mark.parametrize("layer", ["river", "lake"])
def test_a_draft_has_painted_water_where_the_terrain_has_it(built, layer):
    sketch, memory, before, recipe = built
    plan = evaluation(
        stroke(sketch, layer, round(0.75 * sketch.height_px), round(0.2 * sketch.width_px), 5), memory
    )
    (draft,) = draft_recipes(plan, before)
    final = plan["recipe"]
    assert {each.id for each in draft.rivers if each.label} == {
        each.id for each in final.rivers if each.label
    }
    lakes, finals, old = ({each.id: each for each in of.lakes} for of in (draft, final, recipe))
    assert lakes.keys() == finals.keys()
    new = lakes.keys() - old.keys()
    assert len(new) == (layer == "lake")
    for name in new:
        assert lakes[name].level == pytest.approx(finals[name].level, abs=10.0)


def test_roads_of_drafts_are_those_of_before_on_the_final_ground(built):
    sketch, memory = built[:2]
    line = np.array([[0.1, 0.15], [0.9, 0.2]]) * sketch.size
    sketch = sketch.replace(
        vectors={
            **sketch.vectors,
            "road": FeatureTable.from_shapes("road", np.array([shapely.LineString(line)])),
        }
    )
    before = evaluation(sketch, memory)
    network = before["recipe"].network
    plan = evaluation(stroke(sketch, "hill", 40, 40, 12), memory)
    *_, draft = draft_recipes(plan, before)
    assert draft.network is network
    assert draft[ReliefLayer] is plan["recipe"][ReliefLayer]
    assert [type(each) for each in draft.layers] == [type(each) for each in plan["recipe"].layers]


def test_a_change_of_more_than_a_stroke_has_no_draft(built):
    sketch, memory, before, _ = built
    for setting in ({"fidelity": 0.5}, {"extent": 2.0 * sketch.extent}):
        other = stroke(sketch, "mountain", 20, 20, 9).replace(**setting)
        assert not list(draft_recipes(evaluation(other, memory), before))


def test_drafts_keep_all_that_did_not_change(built):
    sketch, memory, before, recipe = built
    plan = evaluation(stroke(sketch, "mountain", 40, 40, 12), memory)
    old, new = (each[ReliefLayer].painted.levels[0] for each in (recipe, next(draft_recipes(plan, before))))
    assert (new.column, new.row) == (old.column, old.row)
    np.testing.assert_array_equal(new.wetness, old.wetness)
    assert np.isnan(new.height).sum() == np.isnan(old.height).sum()
    assert (new.height == old.height).mean() > 0.5


def test_the_first_stroke_on_an_empty_sketch_has_a_draft(context):
    sketch, memory = Sketch(extent=2048.0, layers={"mountain": np.zeros((64, 64), np.uint8)}), Results()
    before = evaluation(sketch, memory)
    recipe = before["recipe"]
    changed = stroke(sketch, "mountain", 32, 32, 9)
    draft = next(draft_recipes(evaluation(changed, memory), before))
    flat, risen = (float(Terrain(sketch, each, context).heights(1024.0, 1024.0)) for each in (recipe, draft))
    assert risen > flat + 50.0
