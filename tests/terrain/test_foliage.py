"""Plants: species, density, spacing by the terrain, independence of the queried area, and edits."""

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.generation.building import build, rebuild
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.landforms.placement.feature_types import conifer_code
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.recipe import touches
from sketchterrain.vegetation import foliage
from sketchterrain.vegetation.foliage import LEVELS, FoliageSampler, Meadow
from sketchterrain.vegetation.plants import PLANT, SPECIES, STOREYS, SpacingBlocks
from sketchterrain.vegetation.woods import Woods

from .conftest import cover, feature, lake, tiers

FAR = 1_000_000.0  # m


def grown(recipe, context, *area, storey: str = "woody") -> np.ndarray:
    return FoliageSampler(Evaluator(recipe, context)).within(area, storey)


def test_forests_grow_where_they_are_painted(valley, desert) -> None:
    assert len(desert.foliage(2000, 2000, 4000, 4000)) < 40
    forest = valley.sketch.layers["forest"] > 0
    area = (*(0.5 * side for side in valley.size), *valley.size)  # the north-east
    plants = valley.foliage(*area)
    column = (plants["x"] / valley.sketch.pixel_size).astype(int)
    row = valley.sketch.height_px - 1 - (plants["y"] / valley.sketch.pixel_size).astype(int)
    inside = forest[row, column].mean()
    assert inside > 0.6  # groves of the fill and isolated trees are elsewhere
    assert inside > 5 * forest[: forest.shape[0] // 2, forest.shape[1] // 2 :].mean()
    assert len(plants) <= valley.foliage_estimate(*area)[0] <= 2 * len(plants)


def test_a_forest_has_the_share_of_conifers_of_its_label(make_recipe, context) -> None:
    for share, low, high in ((0.0, 0.0, 0.02), (0.6, 0.5, 0.7), (1.0, 0.98, 1.0)):
        recipe = make_recipe(wide_forest(share))
        plants = grown(recipe, context, 1800, 1800, 2200, 2200)
        trees = plants[plants["species"] != SPECIES.index("shrub")]
        assert len(trees) > 500
        conifers = np.isin(trees["species"], [SPECIES.index("spruce"), SPECIES.index("pine")])
        assert low <= conifers.mean() <= high, share


def wide_forest(share: float = -1.0) -> np.ndarray:
    return feature("forest", 2000, 2000, 600, 0.9, peakiness=conifer_code(share))


def test_no_tree_grows_in_a_lake(make_recipe, context) -> None:
    recipe = make_recipe(wide_forest(), lakes=(lake(2000, 2000, 80, 10.0, spacing=5.0),))
    plants = grown(recipe, context, 1850, 1850, 2150, 2150)
    distance = np.hypot(plants["x"] - 2000, plants["y"] - 2000)
    assert len(plants) > 300
    assert distance.min() > 80
    assert distance.min() < 95
    flooded = make_recipe(wide_forest(1.0), lakes=(lake(2000, 2000, 400, 10.0),))
    assert grown(flooded, context, 1900, 1900, 2100, 2100).size == 0


def spacing_at(recipe, context, rule, *area) -> np.ndarray:
    """Return the raster of a rectangle (m), in metres, NaN where nothing grows."""
    unit = metres_per_unit(recipe.extent)
    rule_of_recipe = rule(Evaluator(recipe, context))
    raster = SpacingBlocks(rule_of_recipe, recipe.extent).raster(*(round(each / unit) for each in area))
    return np.where(raster.spacing > rule_of_recipe.most, np.nan, raster.spacing * unit)


def test_no_trees_above_the_tree_line_and_on_walls(make_recipe, context) -> None:
    mountain = feature("mountain", 2000, 2000, 1200, 1100, peakiness=0.6)
    forest = feature("forest", 2000, 2000, 1500, 1.0)
    recipe = make_recipe(mountain, forest)
    unit = metres_per_unit(recipe.extent)
    woods = Woods(Evaluator(recipe, context))
    raster = SpacingBlocks(woods, recipe.extent).raster(*(round(v / unit) for v in (800, 800, 3200, 3200)))
    grows = raster.spacing <= woods.most
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
    assert not grows[height > 460].any()
    assert not grows[1:-1, 1:-1][walls].any()
    assert grows[1:-1, 1:-1][low & (steep < 0.7)].mean() > 0.8


def test_grass_density_follows_the_material(make_recipe, context) -> None:
    sand, soil = 4, 1  # of MATERIALS
    sandy, soiled = cover(1500, 2000, 200, sand), cover(2500, 2000, 200, soil)
    forest = feature("forest", 2000, 1000, 300, 1.0)
    recipe = make_recipe(
        forest, covers=(sandy, soiled), climate={"snow_line": 1e4, "tree_line": 1e4, "aridity": 0.0}
    )
    around = {
        name: np.nanmedian(spacing_at(recipe, context, Meadow, x - 60, y - 60, x + 60, y + 60))
        for name, x, y in (
            *(("meadow", 2000, 2000), ("sand", 1500, 2000)),
            *(("soil", 2500, 2000), ("forest", 2000, 1000)),
        )
    }
    assert 0.45 < around["meadow"] < 1.0
    assert around["meadow"] < around["forest"] < around["soil"] < around["sand"]


def test_a_lakes_bed_does_not_thin_trees_ashore(make_recipe, context) -> None:
    forest = feature("forest", 2000, 2000, 900, 1.0, peakiness=conifer_code(1.0))
    dry = spacing_at(make_recipe(forest), context, Woods, 1700, 1700, 2300, 2300)
    recipe = make_recipe(forest, lakes=(lake(2000, 2000, 150, 4.0),))
    wet = spacing_at(recipe, context, Woods, 1700, 1700, 2300, 2300)
    assert np.nanmax(wet / dry) < 1.5


SIDES = {"woody": 500.0, "grass": 60.0}  # m of a rectangle with some thousand plants
PLACES = [(2100.0, 1500.0), (-700.0, 5200.0), (-3 * FAR, FAR), (-3 * FAR, 2 * FAR)]


def square(place: tuple[float, float], storey: str) -> tuple[float, float, float, float]:
    west, south = place
    return west, south, west + SIDES[storey], south + SIDES[storey]


@tiers(
    ("storey", "place"),
    [("woody", PLACES[0]), ("grass", PLACES[1])],
    [("grass", PLACES[3]), ("woody", PLACES[2])],
)
def test_plants_are_a_function_of_the_world(valley, place, storey) -> None:
    """One rectangle, or sixteen in shuffled order from a new sampler: the same bits."""
    west, south, east, north = square(place, storey)
    whole = valley.foliage(west, south, east, north, storey=storey)
    assert len(whole) > 50
    fresh = FoliageSampler(Evaluator(valley.recipe, valley.context))
    cuts_x, cuts_y = (np.linspace(low, high, 5) for low, high in ((west, east), (south, north)))
    tiles = [(i, j) for i in range(4) for j in range(4)]
    np.random.default_rng(1).shuffle(tiles)
    for i, j in tiles:
        x0, y0, x1, y1 = cuts_x[i], cuts_y[j], cuts_x[i + 1], cuts_y[j + 1]
        inside = (whole["x"] >= x0) & (whole["x"] < x1) & (whole["y"] >= y0) & (whole["y"] < y1)
        np.testing.assert_array_equal(fresh.within((x0, y0, x1, y1), storey), whole[inside])


@pytest.mark.parametrize("storey", STOREYS)
def test_every_field_of_a_plant_is_set(valley, storey) -> None:
    plants = valley.foliage(*square(PLACES[0], storey), storey=storey)
    assert plants.dtype == PLANT
    names = {SPECIES[number] for number in np.unique(plants["species"])}
    assert names <= set(STOREYS[storey])
    assert len(names) > 1
    np.testing.assert_allclose(np.linalg.norm(plants["normal"], axis=1), 1.0, atol=1e-6)
    assert (plants["normal"][:, 2] > 0.5).all()
    np.testing.assert_array_equal(plants["z"], valley.heights(plants["x"], plants["y"]))
    for name, low, high in (("tint", 0, 1), ("rotation", 0, 2 * np.pi)):
        assert low <= plants[name].min() < low + 0.1 * high
        assert 0.9 * high < plants[name].max() <= high
    assert set(np.unique(plants["level"])) <= set(range(LEVELS + 1))
    # A level holds about a quarter of the one below it.
    share = (plants["level"] >= 1).mean()
    assert 0.1 < share < 0.45
    x, y, d = plants["x"], plants["y"], 0.5
    east = (valley.heights(x + d, y) - valley.heights(x - d, y)) / (2 * d)
    north = (valley.heights(x, y + d) - valley.heights(x, y - d)) / (2 * d)
    normal = np.stack([-east, -north, np.ones_like(east)], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert np.sum(normal * plants["normal"], axis=1).min() > 0.99


@pytest.mark.parametrize("storey", STOREYS)
def test_pieces_join_to_the_whole(valley, storey, monkeypatch) -> None:
    west, south, east, north = square(PLACES[0], storey)
    width = {"woody": 800.0, "grass": 80.0}[storey]
    area = (west - width, south - 100.0, east, north)
    whole = valley.foliage(*area, storey=storey)
    monkeypatch.setattr(foliage, "_MAX_PER_PIECE", 1)
    pieces = list(valley.foliage_pieces(*area, storey=storey))
    assert len(pieces) > 3
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_an_estimate_is_a_close_upper_bound(valley) -> None:
    for storey, place in (("woody", PLACES[0]), ("woody", PLACES[1]), ("grass", PLACES[2])):
        area = square(place, storey)
        most, size = valley.foliage_estimate(*area, storey=storey)
        there = len(valley.foliage(*area, storey=storey))
        assert there <= most <= 2 * there + 100, (storey, area)
        assert size == most * PLANT.itemsize
        assert valley.foliage_estimate(0, 0, 0, 500, storey=storey) == (0, 0)


def test_invalid_areas_and_storeys_are_errors(valley, monkeypatch) -> None:
    for area, message in (
        ((10, 0, 0, 10), "west ≤ east and south ≤ north, got 10, 0, 0, 10"),
        ((0, 10, 10, 0), "west ≤ east and south ≤ north"),
        ((0, 0, np.nan, 10), "coordinates must be finite"),
        ((-np.inf, 0, 10, 10), "coordinates must be finite"),
        ((0, 0, 1e300, 10), "coordinates must be finite and within"),
    ):
        for query in (valley.foliage, valley.foliage_pieces, valley.foliage_estimate):
            with pytest.raises(InputError, match=message) as error:
                query(*area)
            assert "\n" not in str(error.value)
        with pytest.raises(InputError, match=message):
            next(valley.foliage_steps(*area))
    with pytest.raises(InputError, match="expected a storey, woody or grass, got 'moss'"):
        valley.foliage(0, 0, 1, 1, storey="moss")
    with pytest.raises(InputError, match=r"may hold .*e\+0\d plants \(\d+\.\d GiB\); expected at most 2"):
        valley.foliage(0, 0, 4000, 4000, storey="grass")
    monkeypatch.setattr(foliage, "_MAX_PER_PIECE", 1)
    pieces = valley.foliage_pieces(0, 0, 4000, 4000, storey="grass")
    assert len(next(pieces)) > 1000


@tiers("extent", [4096.0], [1.0], [1e6])
def test_a_forest_of_one_pixel_in_a_sketch_of_any_size(context, extent) -> None:
    """A pixel of 3 cm, of 128 m, of 31 km; lattice units from a fraction of a micrometre to 6 cm."""
    forest = np.zeros((32, 32), np.uint8)
    forest[16, 16] = 1
    sketch = Sketch(extent=extent, layers={"forest": forest}, density={"forest": 0.0})
    terrain = build(sketch, device=context)
    middle = extent * 16.5 / 32
    for storey, half in (("woody", min(500.0, 250.0 * extent)), ("grass", min(20.0, 10.0 * extent))):
        area = (middle - half, middle - half, middle + half, middle + half)
        plants = terrain.foliage(*area, storey=storey)
        assert len(plants) > 10, storey
        assert (np.abs(plants["x"] - middle) <= half + metres_per_unit(extent)).all()
    assert terrain.foliage(middle, middle, middle, middle).size == 0


@tiers("storey", ["woody"], ["grass"])
def test_an_edit_changes_only_nearby_plants(context, storey) -> None:
    """A forest loses its east."""
    forest = np.zeros((64, 64), np.uint8)
    forest[6:24, 6:26] = forest[10:24, 36:56] = 1
    sketch = Sketch(extent=4096.0, seed=9, layers={"forest": forest}, density={"forest": 0.0})
    before = build(sketch, device=context)
    image = forest.copy()
    image[10:24, 48:56] = 0
    after, areas = rebuild(before, sketch.replace(layers={**sketch.layers, "forest": image}))
    area = {"woody": (1000.0, 1500.0, 4096.0, 3800.0), "grass": (2900.0, 2400.0, 3200.0, 2700.0)}[storey]
    plants = [each.foliage(*area, storey=storey) for each in (before, after)]
    rows = [{row.tobytes() for row in each} for each in plants]
    beyond = {"woody": 300.0, "grass": 40.0}[storey]
    changed = np.concatenate(
        [
            each[[row.tobytes() not in other for row in each]]
            for each, other in zip(plants, rows[::-1], strict=True)
        ]
    )
    assert len(changed) > 100
    assert all(touches(areas, (x, y, x, y), margin=beyond) for x, y in changed[["x", "y"]].tolist())
    kept = plants[0][["x", "y"]].tolist()
    assert sum(not touches(areas, (x, y, x, y), margin=beyond) for x, y in kept) > 1000
