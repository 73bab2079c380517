"""Plants of sketches: species, density, and the spacing that the ground gives them."""

import numpy as np
import pytest

from sketchterrain.features import FEATURE, Lake, ShapeField
from sketchterrain.features.catalogue import conifer_code
from sketchterrain.terrain import plant_spacing
from sketchterrain.terrain.evaluation import Evaluator
from sketchterrain.terrain.foliage import FoliageSampler
from sketchterrain.terrain.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.meadow import Meadow
from sketchterrain.terrain.plant import SPECIES
from sketchterrain.terrain.plant_noise import PlantNoise
from sketchterrain.terrain.plant_spacing import FILL, SpacingBlocks, density_of, spacing_of, whole_step
from sketchterrain.terrain.woods import Woods

from .conftest import cover, feature, lake


def test_forests_are_where_they_are_painted(valley, desert) -> None:
    assert len(desert.foliage(2000, 2000, 4000, 4000)) < 40
    forest = valley.sketch.layers["forest"] > 0
    plants = valley.foliage(0, 0, *valley.size)
    column = (plants["x"] / valley.sketch.pixel_size).astype(int)
    row = valley.sketch.height_px - 1 - (plants["y"] / valley.sketch.pixel_size).astype(int)
    inside = forest[row, column].mean()
    assert inside > 0.6  # groves of the fill and lone trees stand elsewhere
    assert inside > 5 * forest.mean()
    assert len(plants) <= valley.foliage_estimate(0, 0, *valley.size)[0] <= 2 * len(plants)


def test_a_forest_has_the_share_of_conifers_of_its_label(make_recipe, context) -> None:
    for share, low, high in ((0.0, 0.0, 0.02), (0.6, 0.5, 0.7), (1.0, 0.98, 1.0)):
        recipe = make_recipe(wide_forest(share))
        plants = FoliageSampler(Evaluator(recipe, context)).within(1800, 1800, 2200, 2200)
        trees = plants[plants["species"] != SPECIES.index("shrub")]
        assert len(trees) > 500
        conifers = np.isin(trees["species"], [SPECIES.index("spruce"), SPECIES.index("pine")])
        assert low <= conifers.mean() <= high, share


def wide_forest(share: float = -1.0) -> np.ndarray:
    return feature("forest", 2000, 2000, 600, 0.9, peakiness=conifer_code(share))


def per_cell(x: np.ndarray, y: np.ndarray, width: float, weights: np.ndarray | None = None) -> np.ndarray:
    _, col = np.unique(np.floor(x / width), return_inverse=True)
    _, row = np.unique(np.floor(y / width), return_inverse=True)
    return np.bincount(col * (row.max() + 1) + row, weights, minlength=(col.max() + 1) * (row.max() + 1))


def test_species_stand_in_patches(make_recipe, context) -> None:
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


def test_undergrowth_stands_at_a_forests_edge(make_recipe, context) -> None:
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


def test_lone_plants_stand_in_loose_groups(make_recipe, context) -> None:
    sampler = FoliageSampler(Evaluator(make_recipe(np.zeros(0, FEATURE)), context))
    plants = sampler.within(0, 0, 4000, 4000)
    assert 2000 < len(plants) < 12000
    many = per_cell(plants["x"], plants["y"], 100.0)
    assert many.var() > 2.0 * many.mean()  # strewn evenly, both would be about the same


def test_no_tree_stands_in_a_lake(make_recipe, context) -> None:
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


RULES = [Woods, Meadow]
FAR = 1_000_000.0  # m


def spacing_at(recipe, context, rule, *area) -> np.ndarray:
    """The raster of a rectangle (m), in metres, not a number where nothing stands."""
    unit = metres_per_unit(recipe.extent)
    chosen = rule(Evaluator(recipe, context))
    raster = SpacingBlocks(chosen, recipe.extent).raster(*(round(each / unit) for each in area))
    return np.where(raster.spacing > chosen.most, np.nan, raster.spacing * unit)


@pytest.mark.parametrize(("rule", "origin"), [(Woods, (-FAR, FAR)), (Meadow, (0.0, 0.0))])
def test_spacing_is_independent_of_the_queried_area(valley, rule, origin, monkeypatch) -> None:
    chosen = rule(valley._evaluator)
    side = 4 * plant_spacing.BLOCK * chosen.step
    unit = metres_per_unit(valley.extent)
    west, south = (round(each / unit) // chosen.step * chosen.step for each in origin)
    whole = SpacingBlocks(chosen, valley.extent).raster(west, south, west + side, south + side)
    assert (whole.west, whole.south, whole.step) == (west, south, chosen.step)
    assert whole.spacing.shape == (side // chosen.step + 1,) * 2
    monkeypatch.setattr(plant_spacing, "_KEPT", 3)  # so that blocks are made again
    blocks = SpacingBlocks(chosen, valley.extent)
    for u, v in np.random.default_rng(0).integers(0, side - 7 * chosen.step, (12, 2)).tolist():
        part = blocks.raster(west + u, south + v, west + u + 7 * chosen.step, south + v + 5 * chosen.step)
        column, row = u // chosen.step, v // chosen.step
        rows, columns = part.spacing.shape
        assert (part.west, part.south) == (west + column * chosen.step, south + row * chosen.step)
        assert part.west + (columns - 1) * part.step >= west + u + 7 * chosen.step
        assert part.south + (rows - 1) * part.step >= south + v + 5 * chosen.step
        np.testing.assert_array_equal(
            part.spacing, whole.spacing[row : row + rows, column : column + columns]
        )


@pytest.mark.parametrize("rule", RULES)
def test_spacing_stays_in_its_range(valley, rule) -> None:
    chosen = rule(valley._evaluator)
    unit = metres_per_unit(valley.extent)
    area = (round(each / unit) for each in (2000, 1500, 2600, 2100))
    spacing = SpacingBlocks(chosen, valley.extent).raster(*area).spacing
    assert spacing.dtype == np.float32
    assert spacing.min() >= chosen.least
    assert spacing.max() < 1.3 * chosen.most
    assert (spacing <= chosen.most).mean() > 0.2


def test_noise_over_a_grid_is_that_at_its_places(make_recipe) -> None:
    noise = PlantNoise(make_recipe())
    x = np.arange(-300, 500, 7, dtype=np.int64) * 1024
    y = np.arange(90_000, 90_300, 11, dtype=np.int64) * 1024
    x_at, y_at = (each.ravel() for each in np.meshgrid(x, y))
    for width in (6.0, 55.0, 420.0):
        at = noise.at("group", width, x_at, y_at).reshape(y.size, x.size)
        np.testing.assert_array_equal(noise.over("group", width, x, y), at)


def test_density_and_spacing_are_inverse_and_steps_are_powers_of_two() -> None:
    spacing = np.array([0.5, 3.5, 64.0])
    np.testing.assert_allclose(spacing_of(density_of(spacing)), spacing)
    assert float(density_of(1.0)) == FILL
    for extent in (1.0, 3072.0, 4096.0, 1e6):
        step = whole_step(8.0, extent)
        assert step & (step - 1) == 0, extent
        assert 2**-0.5 <= step * metres_per_unit(extent) / 8.0 <= 2**0.5, extent


def test_half_a_forest_stands_at_root_two_times_the_distance(make_recipe, context) -> None:
    def middle(strength: float) -> np.ndarray:
        forest = feature("forest", 2000, 2000, 900, strength, peakiness=conifer_code(1.0))
        return spacing_at(make_recipe(forest), context, Woods, 1850, 1850, 2150, 2150)

    full, half = middle(1.0), middle(0.5)
    assert full.min() > 3.6
    assert np.median(full) < 6.4
    # But for clearings, where lone plants and seedlings stand.
    assert np.isclose(half / full, np.sqrt(2.0), rtol=1e-3)[full < 6.4].mean() > 0.98


def test_trees_end_at_the_tree_line_and_at_walls(make_recipe, context) -> None:
    mountain = feature("mountain", 2000, 2000, 1200, 1100, peakiness=0.6)
    forest = feature("forest", 2000, 2000, 1500, 1.0)
    recipe = make_recipe(mountain, forest)
    unit = metres_per_unit(recipe.extent)
    woods = Woods(Evaluator(recipe, context))
    raster = SpacingBlocks(woods, recipe.extent).raster(*(round(v / unit) for v in (800, 800, 3200, 3200)))
    stands = raster.spacing <= woods.most
    rows, columns = raster.spacing.shape
    at = np.meshgrid(
        raster.west + raster.step * np.arange(columns), raster.south + raster.step * np.arange(rows)
    )
    x, y = (each.ravel().astype(np.int64) for each in at)
    height, _ = Evaluator(recipe, context).points(x, y, cell_size=raster.step * unit)
    height = height.reshape(rows, columns)
    north, east = np.gradient(height.astype(np.float64), raster.step * unit)
    steep = np.hypot(east, north)[1:-1, 1:-1]
    low, walls = (height < 340)[1:-1, 1:-1], steep > 1.0
    assert not stands[height > 460].any()
    assert not stands[1:-1, 1:-1][walls].any()
    assert stands[1:-1, 1:-1][low & (steep < 0.7)].mean() > 0.8


def test_grass_grows_where_the_ground_lets_it(make_recipe, context) -> None:
    sand, soil = 4, 1  # of MATERIALS
    sandy, soiled = cover(1500, 2000, 200, sand), cover(2500, 2000, 200, soil)
    forest = feature("forest", 2000, 1000, 300, 1.0)
    recipe = make_recipe(
        forest, covers=(sandy, soiled), climate={"snow_line": 1e4, "tree_line": 1e4, "aridity": 0.0}
    )
    around = {
        name: np.nanmedian(spacing_at(recipe, context, Meadow, x - 60, y - 60, x + 60, y + 60))
        for name, (x, y) in {
            "meadow": (2000, 2000),
            "sand": (1500, 2000),
            "soil": (2500, 2000),
            "forest": (2000, 1000),
        }.items()
    }
    assert 0.45 < around["meadow"] < 1.0
    assert around["meadow"] < around["forest"] < around["soil"] < around["sand"]


def test_a_lakes_bed_does_not_thin_the_trees_ashore(make_recipe, context) -> None:
    forest = feature("forest", 2000, 2000, 900, 1.0, peakiness=conifer_code(1.0))
    dry = spacing_at(make_recipe(forest), context, Woods, 1700, 1700, 2300, 2300)
    recipe = make_recipe(forest, lakes=(lake(2000, 2000, 150, 4.0),))
    wet = spacing_at(recipe, context, Woods, 1700, 1700, 2300, 2300)
    assert np.nanmax(wet / dry) < 1.5
