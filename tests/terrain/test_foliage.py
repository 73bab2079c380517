"""Plants: species, density, spacing by the terrain, independence of the queried area, and edits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

import sketchterrain as st
from sketchterrain.array_types import Bounds
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.generation.building import build, rebuild
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.landforms.placement.feature_types import conifer_code
from sketchterrain.terrain.changes import touches
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.vegetation import foliage
from sketchterrain.vegetation import plants as plant_spacing
from sketchterrain.vegetation.foliage import LEVELS, FoliageSampler, Meadow
from sketchterrain.vegetation.plants import PLANT, SPECIES, STOREYS, PlantNoise, SpacingBlocks
from sketchterrain.vegetation.woods import Woods

from .conftest import Cone, cover, feature, lake, tiers

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


def per_cell(x: np.ndarray, y: np.ndarray, width: float, weights: np.ndarray | None = None) -> np.ndarray:
    _, col = np.unique(np.floor(x / width), return_inverse=True)
    _, row = np.unique(np.floor(y / width), return_inverse=True)
    return np.bincount(col * (row.max() + 1) + row, weights, minlength=(col.max() + 1) * (row.max() + 1))


def test_species_grow_in_stands(make_recipe, context) -> None:
    for share, first, second in ((1.0, "spruce", "pine"), (0.0, "oak", "birch")):
        plants = grown(make_recipe(wide_forest(share)), context, 1600, 1600, 2400, 2400)
        pair = [SPECIES.index(first), SPECIES.index(second)]
        plants = plants[np.isin(plants["species"], pair)]
        is_first = (plants["species"] == pair[0]).astype(float)
        assert 0.1 < is_first.mean() < 0.9
        many, own = (per_cell(plants["x"], plants["y"], 100.0, each) for each in (None, is_first))
        shares = own[many > 40] / many[many > 40]
        expected_deviation = np.sqrt(is_first.mean() * (1 - is_first.mean()) / 40)
        assert shares.std() > 2.0 * expected_deviation, (first, second)


def test_undergrowth_grows_at_a_forests_edge(make_recipe, context) -> None:
    evaluator = Evaluator(make_recipe(wide_forest(0.5)), context)
    plants = FoliageSampler(evaluator).within((1300, 1300, 2700, 2700))
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
    deep = inside & (centre < 0.7 * rim)
    assert low[deep].mean() < 0.35
    # Walls have no mantle: trees rise from the edge inwards.
    trees = plants["species"] != SPECIES.index("shrub")
    assert np.median(plants["scale"][edge & trees]) < 0.75 * np.median(plants["scale"][deep & trees])


def test_isolated_plants_form_loose_groups(make_recipe, context) -> None:
    plants = grown(make_recipe(), context, 0, 0, 2000, 4000)
    assert 1000 < len(plants) < 6000
    many = per_cell(plants["x"], plants["y"], 100.0)
    assert many.var() > 2.0 * many.mean()  # a Poisson process would have equal ones


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


@pytest.mark.parametrize(("rule", "origin"), [(Woods, (-FAR, FAR)), (Meadow, (0.0, 0.0))])
def test_spacing_is_independent_of_the_queried_area(valley, rule, origin, monkeypatch) -> None:
    own = rule(valley._evaluator)
    side = 4 * plant_spacing.BLOCK * own.step
    unit = metres_per_unit(valley.extent)
    west, south = (round(each / unit) // own.step * own.step for each in origin)
    whole = SpacingBlocks(own, valley.extent).raster(west, south, west + side, south + side)
    assert (whole.west, whole.south, whole.step) == (west, south, own.step)
    assert whole.spacing.shape == (side // own.step + 1,) * 2
    assert whole.spacing.dtype == np.float32
    assert whole.spacing.min() >= own.least
    assert whole.spacing.max() < 1.3 * own.most
    monkeypatch.setattr(plant_spacing, "_CACHED", 3)  # so that blocks are evaluated again
    blocks = SpacingBlocks(own, valley.extent)
    for u, v in np.random.default_rng(0).integers(0, side - 7 * own.step, (12, 2)).tolist():
        part = blocks.raster(west + u, south + v, west + u + 7 * own.step, south + v + 5 * own.step)
        column, row = u // own.step, v // own.step
        rows, columns = part.spacing.shape
        assert (part.west, part.south) == (west + column * own.step, south + row * own.step)
        assert part.west + (columns - 1) * part.step >= west + u + 7 * own.step
        assert part.south + (rows - 1) * part.step >= south + v + 5 * own.step
        np.testing.assert_array_equal(
            part.spacing, whole.spacing[row : row + rows, column : column + columns]
        )


def test_noise_over_a_grid_equals_noise_at_its_positions(make_recipe) -> None:
    noise = PlantNoise(make_recipe())
    x = np.arange(-300, 500, 7, dtype=np.int64) * 1024
    y = np.arange(90_000, 90_300, 11, dtype=np.int64) * 1024
    x_at, y_at = (each.ravel() for each in np.meshgrid(x, y))
    for width in (6.0, 55.0, 420.0):
        at = noise.at("group", width, x_at, y_at).reshape(y.size, x.size)
        np.testing.assert_array_equal(noise.over_grid("group", width, x, y), at)


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


@tiers(
    ("storey", "place"),
    [("grass", PLACES[2])],
    [("woody", PLACES[0]), ("woody", PLACES[2])],
)
def test_plants_keep_the_distance_of_the_raster(valley, place, storey) -> None:
    """At every level, by a tree of all pairs that could be too near."""
    plants = valley.foliage(*square(place, storey), storey=storey)
    unit = metres_per_unit(valley.extent)
    spacing = unit * raster_at(valley, plants, storey)
    for level in range(LEVELS + 1):
        of_level = plants["level"] >= level
        if not of_level.any():
            continue
        at = np.stack([plants["x"] - place[0], plants["y"] - place[1]], axis=-1)[of_level]
        own = spacing[of_level] * 2**level
        # All within the greatest distance would be most pairs: sorted by distance, near ones first.
        for limit in np.unique(np.minimum(2.0 ** np.ceil(np.log2(own)), own.max())):
            some = own <= limit
            pairs = cKDTree(at[some]).query_pairs(limit, output_type="ndarray")
            away = np.linalg.norm(at[some][pairs[:, 0]] - at[some][pairs[:, 1]], axis=1)
            needed = own[some][pairs].mean(axis=1)
            assert (away >= needed * (1 - 1e-5) - 2 * unit).all()


def raster_at(terrain: st.Terrain, plants: np.ndarray, storey: str) -> np.ndarray:
    """Return the raster's spacing at plants, lattice units, in float64."""
    x, y = to_lattice(np.stack([plants["x"], plants["y"]]), terrain.extent)
    blocks = terrain._foliage._storeys[storey]._spacing
    raster = blocks.raster(int(x.min()), int(y.min()), int(x.max()) + 1, int(y.max()) + 1)
    u, v = (x - raster.west) / raster.step, (y - raster.south) / raster.step
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    u, v, corner = u - i, v - j, raster.spacing.astype(np.float64)
    south = (1 - u) * corner[j, i] + u * corner[j, i + 1]
    north = (1 - u) * corner[j + 1, i] + u * corner[j + 1, i + 1]
    return (1 - v) * south + v * north


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


def test_a_sparse_forest_is_as_even_as_a_dense_one(make_recipe, context) -> None:
    """Not a dense one with random trees omitted, some of which would be adjacent."""

    def inside(strength: float) -> np.ndarray:
        forest = feature("forest", 2000, 2000, 900, strength, peakiness=conifer_code(0.5))
        plants = grown(make_recipe(forest), context, 1750, 1750, 2250, 2250)
        return np.stack([plants["x"], plants["y"]], axis=-1)

    full, thin = inside(1.0), inside(0.25)
    assert len(thin) / len(full) == pytest.approx(0.25, rel=0.12)
    # Not the minimum: the species of the nearest of some thousand pairs are random.
    apart = [np.quantile(cKDTree(at).query(at, k=2)[0][:, 1], [0.01, 0.1, 0.5]) for at in (full, thin)]
    assert (apart[1] > 1.9 * apart[0]).all()


def test_trees_are_lower_near_the_tree_line(make_recipe, context) -> None:
    forest = feature("forest", 2000, 2000, 1500, 1.0)
    mountain = ReliefLayer(Cone(700.0, radius=1500.0))
    plants = grown(make_recipe(forest, relief=mountain), context, 1000, 1000, 3000, 2000)
    trees = plants[plants["species"] != SPECIES.index("shrub")]
    high, low = (trees["scale"][trees["z"] > 380], trees["scale"][trees["z"] < 250])
    assert len(high) > 100
    assert len(low) > 1000
    assert trees["z"].max() < 460
    assert np.median(high) < 0.65 * np.median(low)


def test_ferns_grow_in_forests_and_flowers_outside(make_recipe, context) -> None:
    forest = feature("forest", 2000, 2000, 400, 1.0)
    sampler = FoliageSampler(Evaluator(make_recipe(forest), context))

    def shares(x: float, y: float) -> dict[str, float]:
        plants = sampler.within((x - 40, y - 40, x + 40, y + 40), "grass")
        return {name: float(np.mean(plants["species"] == SPECIES.index(name))) for name in STOREYS["grass"]}

    inside, outside = shares(2000, 2000), shares(3200, 3200)
    assert inside["fern"] > 0.4
    assert outside["fern"] == 0.0
    assert outside["grass"] > 0.5
    assert outside["flower"] > inside["flower"]


PIXELS, EXTENT = 64, 4096.0


@pytest.fixture(scope="module")
def before(context) -> st.Terrain:
    """Three forests, and a river between them."""
    forest, river = np.zeros((2, PIXELS, PIXELS), np.uint8)
    forest[6:24, 6:26] = forest[10:24, 36:56] = forest[42:58, 12:52] = 1
    for column in range(8, 56):
        row = round(32 + 2 * np.sin(column / 6))
        river[row, column] = river[row + 1, column] = 1
    layers = {"forest": forest, "river": river}
    return build(Sketch(extent=EXTENT, seed=9, layers=layers, density={"forest": 0.0}), device=context)


def _repainted(terrain: st.Terrain) -> Sketch:
    """Return a sketch whose forest in the north-east has lost its east."""
    layers = {name: layer.copy() for name, layer in terrain.sketch.layers.items()}
    layers["forest"][10:24, 48:56] = 0
    return replace(terrain.sketch, layers=layers)


def _away(
    terrains: tuple[st.Terrain, st.Terrain], storey: str, area: Bounds, plants: np.ndarray
) -> np.ndarray:
    """Return metres from plants to the nearest vertex at which the spacing or the terrain differs."""
    unit = metres_per_unit(EXTENT)
    wider = (area[0] - MARGIN, area[1] - MARGIN, area[2] + MARGIN, area[3] + MARGIN)
    blocks = [each._foliage._storeys[storey]._spacing for each in terrains]
    one, two = (each.raster(*(round(side / unit) for side in wider)) for each in blocks)
    rows, columns = one.spacing.shape
    x = (one.west + np.arange(columns) * one.step) * unit
    y = (one.south + np.arange(rows) * one.step) * unit
    heights = [each.heights(x[None, :], y[:, None]) for each in terrains]
    row, column = np.nonzero((one.spacing != two.spacing) | (heights[0] != heights[1]))
    assert 0 < row.size < 0.6 * one.spacing.size
    changed = cKDTree(np.stack([x[column], y[row]], axis=-1))
    return np.asarray(changed.query(np.stack([plants["x"], plants["y"]], axis=-1))[0])


AREAS = {
    _repainted: {"woody": (2000.0, 1800.0, 4096.0, 3800.0), "grass": (2900.0, 2400.0, 3200.0, 2700.0)},
}
"""Rectangles (m) where plants are compared."""
NEAR = {"woody": (300.0, 30.0, 100.0), "grass": (40.0, 4.0, 10.0)}
"""Distances (m) from the change: no plant differs beyond the first, few beyond the others."""
MARGIN = 400.0  # m around the rectangles


def _others(own: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return which plants are not among the others, bit for bit."""
    there = {row.tobytes() for row in others}
    return np.array([row.tobytes() not in there for row in own], dtype=bool)


@tiers(("edit", "storey"), [(_repainted, "woody")], [(_repainted, "grass")])
def test_an_edit_changes_only_nearby_plants(before, edit, storey) -> None:
    after, areas = rebuild(before, edit(before))
    area = AREAS[edit][storey]
    plants = [each.foliage(*area, storey=storey) for each in (before, after)]
    changed = np.concatenate([_others(*plants), _others(*plants[::-1])])
    both = np.concatenate(plants)
    away = _away((before, after), storey, area, both)
    assert changed.sum() > 100
    near, half, tenth = NEAR[storey]
    assert not changed[away > near].any()
    assert (away > near).sum() > 1000
    assert changed[(away > half) & (away <= near)].mean() < 0.1
    assert changed[(away > tenth) & (away <= near)].mean() < 0.02
    # Plants outside the changed areas are unchanged.
    outside = [
        not touches(areas, (x, y, x, y), margin=near) for x, y in zip(both["x"], both["y"], strict=True)
    ]
    assert not changed[np.array(outside)].any()
