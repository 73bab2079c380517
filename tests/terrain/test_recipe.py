from __future__ import annotations

import pickle
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sketchterrain.features.edits import EditedFill
from sketchterrain.sketch import Edit
from sketchterrain.terrain import Terrain, changed_areas, rebuild

if TYPE_CHECKING:
    from sketchterrain.compute import ComputeContext


def _copied(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))  # noqa: S301


def test_a_pickled_recipe_gives_the_same_heights(valley: Terrain, context: ComputeContext) -> None:
    fill = valley.recipe.fill.within(0.0, 0.0, *valley.size)
    edited, _ = rebuild(valley, valley.sketch.with_edit(Edit("delete", int(fill["id"][0]))))
    assert isinstance(edited.recipe.fill, EditedFill)
    for terrain in (valley, edited):
        recipe = _copied(terrain.recipe)
        other = Terrain(terrain.sketch, recipe, context)
        x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(-3000.0, 9000.0, 90)]))
        for cell in (0.0, 24.0):
            one, two = (each.heights(x, y, cell_size=cell) for each in (terrain, other))
            assert one.tobytes() == two.tobytes()
        assert changed_areas(terrain.recipe, recipe) == []
        with pytest.raises(TypeError):
            recipe.ground["relief"] = 1.0
    assert len(pickle.dumps(valley.recipe)) < 400_000


def test_placed_features_pickle(valley: Terrain) -> None:
    features = valley.features
    other = _copied(features)
    assert other.points.tobytes() == features.points.tobytes()
    for one, two in zip(features.rivers, other.rivers, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(two).values(), strict=True))
