"""What changes of recipes touch and upload, and pickled recipes; updates are those of `test_updates.py`."""

import pickle
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sketchterrain.document.edits import Edit
from sketchterrain.generation.building import make_recipe, rebuild
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.box_index import merge_boxes, row_difference
from sketchterrain.landforms.placement.feature_types import FEATURE, FEATURE_TYPES, lock_edit
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.recipe import EVERYWHERE, TerrainRecipe, changed_areas, touches
from tests import terrains

from .terrain_samples import differences, samples_of


def test_global_settings_change_everything() -> None:
    plain = terrains.plain()
    for change in (
        *({"seed": 6}, {"fidelity": 0.5}, {"ground": {"relief": 41.0}}, {"climate": {"aridity": 0.3}}),
        *({"extent": 900.0}, {"density": {"hill": 0.4}}),
    ):
        assert rebuild(plain, plain.sketch.replace(**change))[1] == [EVERYWHERE], change


def test_a_name_and_locks_change_nothing() -> None:
    plain = terrains.painted()
    assert rebuild(plain, plain.sketch.replace(name="Another name"))[1] == []
    locked = plain.sketch
    for point in plain.features.points[::3]:
        locked = locked.with_edit(lock_edit(point))
    after, areas = rebuild(plain, locked)
    assert len(locked.edits) > 3
    assert areas == []
    x, y = np.random.default_rng(1).uniform(0.0, plain.extent, (2, 500))
    after = Terrain(locked, after.recipe, plain.context)
    np.testing.assert_array_equal(plain.heights(x, y), after.heights(x, y))


def test_an_edit_of_a_feature_changes_its_surroundings_alone() -> None:
    plain = terrains.painted()
    forest = plain.features.points[plain.features.points["type"] == FEATURE_TYPES.index("forest")][0]
    thin = Edit("strength", int(forest["id"]), strength=0.5 * float(forest["strength"]))
    west, south, east, north = np.array(rebuild(plain, plain.sketch.with_edit(thin))[1]).T
    assert 0.0 < ((east - west) * (north - south)).sum() < 0.35 * plain.extent**2


def test_another_extent_is_another_terrain(valley) -> None:
    after, areas = terrains.plain().updated(valley.sketch, valley.recipe)
    assert areas == [EVERYWHERE]
    x, y = np.random.default_rng(3).uniform(0, valley.extent, (2, 300))
    np.testing.assert_array_equal(after.heights(x, y), valley.heights(x, y))


def test_merged_rectangles_cover_all_and_neighbours_are_one() -> None:
    rng = np.random.default_rng(0)
    for count in (0, 1, 2, 40, 300):
        low = rng.uniform(0.0, 1000.0, (count, 2))
        boxes = np.concatenate([low, low + rng.uniform(0.0, 90.0, (count, 2))], axis=1)
        merged = np.array(merge_boxes(map(tuple, boxes.tolist()))).reshape(-1, 4)
        inside = (boxes[:, None, :2] >= merged[:, :2]) & (boxes[:, None, 2:] <= merged[:, 2:])
        assert inside.all(axis=2).any(axis=1).all()
        assert len(merged) <= count
    row = [(10.0 * k, 0.0, 10.0 * k + 25.0, 8.0) for k in range(50)]
    merged = merge_boxes([*row, (3.0, 2.0, 4.0, 3.0), (900.0, 0.0, 950.0, 8.0)])
    assert set(merged) == {(0.0, 0.0, 515.0, 8.0), (900.0, 0.0, 950.0, 8.0)}


def test_touches_includes_borders_and_the_margin() -> None:
    areas = [(0.0, 0.0, 10.0, 10.0)]
    assert touches(areas, (10.0, 10.0, 20.0, 20.0))
    assert touches(areas, (2.0, 2.0, 3.0, 3.0))
    assert not touches(areas, (11.0, 0.0, 20.0, 10.0))
    assert touches(areas, (11.0, 0.0, 20.0, 10.0), margin=1.0)
    assert touches([EVERYWHERE], (1e9, 1e9, 2e9, 2e9))
    assert not touches([], (0.0, 0.0, 1.0, 1.0))


def river_areas(old: TerrainRecipe, new: TerrainRecipe) -> np.ndarray:
    """Return the areas (n, 4), m, outside which rivers are the same."""
    change = new[CorridorsLayer].change(old[CorridorsLayer], new.world)
    assert change is not None
    return change.boxes * new.world.unit


def test_a_river_far_from_the_change_has_the_same_course_and_nearly_its_bed(valley) -> None:
    sketch, old = valley.sketch, valley.recipe
    river = np.array(sketch.layers["river"])
    river[5:8, 5:9] = 1
    new = make_recipe(sketch.replace(layers={**sketch.layers, "river": river}))
    assert len(river_areas(old, new))
    painted = [each for each in old.rivers if each.label]
    after = {each.id: each for each in new.rivers if each.label}
    assert len(after) == len(painted) + 1
    for each in painted:
        line = after[each.id].centreline
        np.testing.assert_array_equal(line[:, :2], each.centreline[:, :2])
        # The ground is drained anew, which moves its height a little.
        assert np.percentile(np.abs(line[:, 2] - each.centreline[:, 2]), 90) < 1.0


def test_unchanged_buffers_are_not_uploaded_again(monkeypatch) -> None:
    """A small stroke leaves most feature batches, and all of rivers, lakes and octaves."""
    plain = terrains.painted()
    samples_of(plain)
    forest = np.array(plain.sketch.layers["forest"])
    forest[30:33, 50:53] = 1
    sketch = plain.sketch.replace(layers={**plain.sketch.layers, "forest": forest})
    recipe = make_recipe(sketch, memory=plain.memory)
    uploads, upload = [], plain.context.upload
    counted = lambda array, **more: (uploads.append(array.nbytes), upload(array, **more))[1]  # noqa: E731
    monkeypatch.setattr(plain.context, "upload", counted)
    after, _ = plain.updated(sketch, recipe)
    uploads.clear()  # of material rules
    samples_of(after)
    updated = len(uploads)
    samples_of(Terrain(sketch, recipe, plain.context))
    assert updated < 0.5 * (len(uploads) - updated)


def _pickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))  # noqa: S301


def test_a_pickled_recipe_gives_the_same_heights(valley, context) -> None:
    fill = valley.recipe.points.fill.within(0.0, 0.0, *valley.size)
    edited, _ = rebuild(valley, valley.sketch.with_edit(Edit("delete", int(fill["id"][0]))))
    assert len(edited.recipe.points.fill.replaced) == 1
    for terrain in (valley, edited):
        recipe = _pickled(terrain.recipe)
        other = Terrain(terrain.sketch, recipe, context)
        assert not differences(samples_of(terrain), samples_of(other))
        assert changed_areas(terrain.recipe, recipe) == []
        with pytest.raises(TypeError):
            recipe.climate["aridity"] = 1.0
    relief = valley.recipe[ReliefLayer]
    bare = valley.recipe.with_layers([replace(relief, painted=None)])
    painted = [course for course in bare[CorridorsLayer].courses if course.river.label]
    assert len(zlib.compress(pickle.dumps(bare.with_layers([CorridorsLayer(tuple(painted))])), 1)) < 400_000
    assert len(zlib.compress(pickle.dumps(bare), 1)) < 1_200_000  # with streams, and outlets of lakes
    assert len(zlib.compress(pickle.dumps(relief), 1)) < 800_000  # the nodes of the painted region
    features, other = valley.features, _pickled(valley.features)
    assert other.points.tobytes() == features.points.tobytes()
    for one, two in zip(features.rivers, other.rivers, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(two).values(), strict=True))


@pytest.mark.parametrize("block", [1, 3, 8, 4096])
def test_row_difference_equals_that_of_sets(monkeypatch, block) -> None:
    monkeypatch.setattr("sketchterrain.geometry.box_index._BLOCK", block)
    rng = np.random.default_rng(block)
    for _ in range(100):
        arrays = []
        for _ in range(2):
            rows = np.zeros(40, FEATURE)
            rows["id"], rows["x"] = np.arange(40), rng.random(40) < rng.choice([0.0, 0.1, 0.5])
            arrays.append(rows[rng.random(40) < rng.choice([0.3, 0.9, 1.0])])
        sets = [{row.tobytes() for row in rows} for rows in arrays]
        for rows, others, found in zip(arrays, sets[::-1], row_difference(*arrays), strict=True):
            assert found.tolist() == [i for i, row in enumerate(rows) if row.tobytes() not in others]
