"""Plants of sketches: where they grow, of which species, and how dense."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features import FEATURE, FEATURE_TYPES, Lake, ShapeField
from sketchterrain.features.catalogue import conifer_code
from sketchterrain.terrain.evaluation import Evaluator
from sketchterrain.terrain.foliage import FoliageSampler
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.plant import SPECIES

if TYPE_CHECKING:
    from collections.abc import Callable

    import sketchterrain as st
    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain import TerrainRecipe


def test_plants_stand_on_the_ground_inside_the_rectangle(valley: st.Terrain) -> None:
    plants = valley.foliage(1800, 1500, 2900, 2800)
    assert len(plants) > 200
    assert (plants["x"] >= 1800).all()
    assert (plants["x"] < 2900).all()
    assert (plants["y"] >= 1500).all()
    assert (plants["y"] < 2800).all()
    np.testing.assert_array_equal(plants["z"], valley.heights(plants["x"], plants["y"]))
    assert set(np.unique(plants["species"])) <= set(range(len(SPECIES)))
    assert (plants["scale"] > 0).all()
    part = valley.foliage(2200, 1700, 2500, 2300)
    inside = (plants["x"] >= 2200) & (plants["x"] < 2500) & (plants["y"] >= 1700) & (plants["y"] < 2300)
    np.testing.assert_array_equal(part, plants[inside])


def test_forests_are_where_they_are_painted(valley: st.Terrain, desert: st.Terrain) -> None:
    assert len(desert.foliage(2000, 2000, 4000, 4000)) < 40
    forest = valley.sketch.layers["forest"] > 0
    plants = valley.foliage(0, 0, *valley.size)
    column = (plants["x"] / valley.sketch.pixel_size).astype(int)
    row = valley.sketch.height_px - 1 - (plants["y"] / valley.sketch.pixel_size).astype(int)
    inside = forest[row, column].mean()
    assert inside > 0.6  # groves of the fill and lone trees stand elsewhere
    assert inside > 5 * forest.mean()
    assert len(plants) <= valley.foliage_estimate(0, 0, *valley.size)[0] <= 2 * len(plants)


def test_a_forest_has_the_share_of_conifers_of_its_label(
    make_recipe: Callable[..., TerrainRecipe], context: ComputeContext
) -> None:
    for share, low, high in ((0.0, 0.0, 0.02), (0.6, 0.5, 0.7), (1.0, 0.98, 1.0)):
        recipe = make_recipe(wide_forest(share))
        plants = FoliageSampler(Evaluator(recipe, context)).within(1800, 1800, 2200, 2200)
        trees = plants[plants["species"] != SPECIES.index("shrub")]
        assert len(trees) > 500
        conifers = np.isin(trees["species"], [SPECIES.index("spruce"), SPECIES.index("pine")])
        assert low <= conifers.mean() <= high, share
        part = FoliageSampler(Evaluator(recipe, context)).within(1900, 1850, 2000, 2100)
        inside = (plants["x"] >= 1900) & (plants["x"] < 2000) & (plants["y"] >= 1850) & (plants["y"] < 2100)
        np.testing.assert_array_equal(part, plants[inside])


def wide_forest(share: float = -1.0) -> np.ndarray:
    forest = np.zeros(1, FEATURE)
    forest["type"], forest["x"], forest["y"] = FEATURE_TYPES.index("forest"), 2000, 2000
    forest["radius"], forest["strength"], forest["peakiness"] = 600, 0.9, conifer_code(share)
    return forest


def per_cell(x: np.ndarray, y: np.ndarray, width: float, weights: np.ndarray | None = None) -> np.ndarray:
    _, col = np.unique(np.floor(x / width), return_inverse=True)
    _, row = np.unique(np.floor(y / width), return_inverse=True)
    return np.bincount(col * (row.max() + 1) + row, weights, minlength=(col.max() + 1) * (row.max() + 1))


def test_species_stand_in_patches(make_recipe: Callable[..., TerrainRecipe], context: ComputeContext) -> None:
    for share, first, second in ((1.0, "spruce", "pine"), (0.0, "oak", "birch")):
        sampler = FoliageSampler(Evaluator(make_recipe(wide_forest(share)), context))
        plants = sampler.within(1500, 1500, 2500, 2500)
        pair = [SPECIES.index(first), SPECIES.index(second)]
        plants = plants[np.isin(plants["species"], pair)]
        is_first = (plants["species"] == pair[0]).astype(float)
        assert 0.1 < is_first.mean() < 0.9
        many, own = (per_cell(plants["x"], plants["y"], 100.0, each) for each in (None, is_first))
        shares = own[many > 40] / many[many > 40]
        by_chance = np.sqrt(is_first.mean() * (1 - is_first.mean()) / 40)
        assert shares.std() > 2.0 * by_chance, (first, second)


def test_undergrowth_stands_at_a_forests_edge(
    make_recipe: Callable[..., TerrainRecipe], context: ComputeContext
) -> None:
    evaluator = Evaluator(make_recipe(wide_forest(0.5)), context)
    plants = FoliageSampler(evaluator).within(1300, 1300, 2700, 2700)
    places = to_lattice(np.stack([plants["x"], plants["y"]]), evaluator.recipe.extent)
    _, masks = evaluator.points(*places, cell_size=2.0)
    low = (plants["species"] == SPECIES.index("shrub")) | (plants["scale"] < 0.6)
    outside, edge, inside = masks[:, 2] < 0.01, (masks[:, 2] > 0.05) & (masks[:, 2] < 0.4), masks[:, 2] > 0.8
    centre = np.hypot(plants["x"] - 2000, plants["y"] - 2000)
    rim = centre[inside].max()
    fringe = outside & (np.abs(centre - rim) < 60)
    assert fringe.sum() > 60
    assert low[fringe].mean() > 0.6
    assert low[edge].mean() > 0.6
    assert low[inside].mean() < 0.35


def test_lone_plants_stand_in_loose_groups(
    make_recipe: Callable[..., TerrainRecipe], context: ComputeContext
) -> None:
    sampler = FoliageSampler(Evaluator(make_recipe(np.zeros(0, FEATURE)), context))
    plants = sampler.within(0, 0, 4000, 4000)
    assert 2000 < len(plants) < 12000
    many = per_cell(plants["x"], plants["y"], 100.0)
    assert many.var() > 2.0 * many.mean()  # strewn evenly, both would be about the same


def test_no_tree_stands_in_a_lake(make_recipe: Callable[..., TerrainRecipe], context: ComputeContext) -> None:
    step = np.arange(-30, 31) * 5.0
    field = ShapeField(1850.0, 1850.0, 5.0, (80 - np.hypot(step, step[:, None])).astype(np.float32))
    recipe = make_recipe(wide_forest(), lakes=(Lake(1, 1, field, 10.0, 5.0),))
    plants = FoliageSampler(Evaluator(recipe, context)).within(1850, 1850, 2150, 2150)
    distance = np.hypot(plants["x"] - 2000, plants["y"] - 2000)
    assert len(plants) > 300
    assert distance.min() > 80
    assert distance.min() < 95
    field = ShapeField(1700.0, 1700.0, 10.0, np.full((61, 61), 300.0, np.float32))
    flooded = make_recipe(wide_forest(1.0), lakes=(Lake(1, 1, field, 10.0, 5.0),))
    assert FoliageSampler(Evaluator(flooded, context)).within(1900, 1900, 2100, 2100).size == 0
