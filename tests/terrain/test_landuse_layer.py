"""Land use as a layer: shares of cells against exact areas, borders, levels of detail, updates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from sketchterrain.compute.context import ComputeContext
from sketchterrain.geometry.box_index import BoxIndex
from sketchterrain.landuse.areas import BUILT_UP, FIELD, FOREST, MEADOW, LandUse
from sketchterrain.schema.layers import CROPS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import MASKS, WorldSettings
from sketchterrain.terrain.recipe import TerrainRecipe, changed_areas
from sketchterrain.vegetation.foliage import FoliageSampler
from sketchterrain.vegetation.plants import SPECIES
from tests.devices import each_other_device
from tests.sample_roads import sketch_with

from .conftest import assert_changed_within, assert_tiles_meet, lake, with_roads

EXTENT, UNIT = 4096.0, 4096.0 / 2**24
WORLD = WorldSettings(EXTENT, 0, 0.0)
CELLS = (0.0, 1.0, 4.0, 16.0, 60.0)
FOREST_MASK = MASKS.index("forest")
SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def areas(*given) -> LandUse:
    """Return areas: their rings (m), and columns that are not those of a full forest."""
    rows, counts, edges = [], [], []
    usual = {"use": FOREST, "crop": 0, "direction": -1.0, "density": 1.0, "conifers": -1.0, "parcels": 0.0}
    for rings, own in given:
        rows.append(usual | own)
        loops = [np.rint(np.asarray(ring, np.float64) * 1024.0) / 1024.0 for ring in rings]
        edges += [np.concatenate([loop, np.roll(loop, -1, axis=0)], axis=1) for loop in loops]
        counts.append(sum(len(loop) for loop in loops))
    columns = {
        name: np.array([row[name] for row in rows], np.uint8 if name in ("use", "crop") else np.float64)
        for name in usual
    }
    ids = np.array([row.get("id", 1 + number) for number, row in enumerate(rows)])
    return LandUse(
        ids,
        **columns,
        first=np.append(0, np.cumsum(counts)),
        edges=np.concatenate([np.zeros((0, 4)), *edges]),
    )


def square(west, south, wide, **own):
    return ([np.array(SQUARE) * wide + (west, south)], own)


def boxes_of(land: LandUse) -> np.ndarray:
    """Return west, south, east and north of areas (n, 4), m."""
    both = land.edges.reshape(-1, 2, 2)
    low, high = (
        reduce.reduceat(reduce.reduce(both, axis=1), land.first[:-1]) for reduce in (np.minimum, np.maximum)
    )
    return np.concatenate([low, high], axis=1)


def with_land(recipe: TerrainRecipe, land: LandUse) -> TerrainRecipe:
    return recipe.with_layers([LandUseLayer(MATERIALS, land)])


def partition(side: int = 12, *, seed: int = 0, at=(1000.0, 1000.0), wide: float = 60.0, **own) -> LandUse:
    """Return jittered quadrilaterals that share their borders, edge by edge."""
    rng = np.random.default_rng(seed)
    row, column = np.indices((side + 1, side + 1))
    nodes = np.stack([column, row], axis=-1) + rng.uniform(-0.3, 0.3, (side + 1, side + 1, 2))
    nodes = nodes * wide + at
    corners = ((0, 0), (0, 1), (1, 1), (1, 0))
    return areas(
        *(([[nodes[j + b, i + a] for b, a in corners]], own) for j in range(side) for i in range(side))
    )


def grid(west, south, wide, count=80):
    """Return lattice positions of a square (m), jittered by row and column."""
    line = np.rint((np.linspace(0.0, wide, count) + 0.37) / UNIT).astype(np.int64)
    x, y = np.meshgrid(line + round(west / UNIT), line + round(south / UNIT))
    return x.ravel(), y.ravel()


@pytest.fixture(scope="module")
def bare(make_recipe) -> TerrainRecipe:
    return make_recipe(ground={"relief": 60.0})


SCENE = areas(
    square(1000, 1000, 300, density=0.7),
    square(1250, 1100, 200, use=FIELD, crop=CROPS.index("ploughed")),
    ([np.array(SQUARE) * 200 + (1000, 1300), np.array(SQUARE) * 60 + (1050, 1350)], {"density": 0.9}),
    ([[(1300, 1300), (1500, 1460), (1500, 1300), (1300, 1380)]], {"density": 0.5}),
    square(1400, 1000, 100, use=MEADOW),
    square(1500, 1000, 100, use=BUILT_UP),
    square(1100, 1050, 30, use=FIELD, crop=CROPS.index("orchard")),
)
"""Areas on each other, with a hole, and a bow-tie."""


def test_kernels_agree_with_numpy_float64(bare, context, double_context) -> None:
    recipe = with_land(bare, SCENE)
    x, y = grid(950, 950, 700)
    for cell in CELLS:
        expected = HostTerrain(recipe).samples(x, y, cell_size=cell).forest
        assert np.ptp(expected) > 0.5
        for opened, share in ((context, 3e-5), (double_context, 1e-9)):
            _, masks = Evaluator(recipe, opened).points(x, y, cell_size=cell)
            assert np.abs(masks[:, FOREST_MASK] - expected).max() < share, cell


def cells_about(x, y, cell):
    half = 0.5 * cell
    return shapely.box(x * UNIT - half, y * UNIT - half, x * UNIT + half, y * UNIT + half)


def test_shares_are_those_of_the_cell_that_an_area_covers(bare) -> None:
    rng, cell = np.random.default_rng(3), 8.0
    ring = 1500.0 + np.array([(0, 0), (170, 20), (200, 150), (90, 110), (10, 190)])
    hole = 1500.0 + np.array([(60, 40), (60, 90), (110, 80)])
    shape = shapely.Polygon(ring, [hole])
    recipe = with_land(bare, areas(([ring, hole], {})))
    x, y = np.rint(rng.uniform(1490.0, 1710.0, (2, 4000)) / UNIT).astype(np.int64)
    found = HostTerrain(recipe).samples(x, y, cell_size=cell).forest
    exact = shapely.area(shapely.intersection(cells_about(x, y, cell), shape)) / cell**2
    corners = shapely.multipoints(np.concatenate([ring, hole]))
    away = shapely.distance(shapely.points(x * UNIT, y * UNIT), corners) > cell
    # A box cut by a slanted line has a share that differs from that of the distance by up to 1/8.
    assert np.abs(found - exact)[away].max() < 0.13
    assert np.abs(found - exact).max() < 0.5
    assert abs(found.mean() - exact.mean()) < 2e-3
    beyond = (exact == 0.0) | (exact > 1.0 - 1e-12)
    off = shapely.distance(shapely.points(x * UNIT, y * UNIT), shape.boundary) > 0.5 * cell
    assert np.array_equal(found[beyond & off], np.rint(exact[beyond & off]))


@pytest.mark.parametrize("far", [0.0, 1e9])
def test_shares_of_a_partition_add_up_to_one(bare, context, far) -> None:
    land = partition(at=(far + 1000.0, 1000.0))
    x, y = grid(far + 1060, 1060, 600)
    for cell in (0.0, 0.5, 2.0, 5.0):
        _, masks = Evaluator(with_land(bare, land), context).points(x, y, cell_size=cell)
        assert np.abs(masks[:, FOREST_MASK] - 1.0).max() < 1e-5, cell
    every = Evaluator(with_land(bare, replace(land, density=np.arange(144) % 2 * 1.0)), context)
    _, masks = every.points(x, y, cell_size=5.0)
    assert 0.3 < masks[:, FOREST_MASK].mean() < 0.7


def test_the_highest_id_is_on_top_and_takes_its_share_first(bare) -> None:
    low, high = square(1000, 1000, 100, density=1.0), square(1050, 1000, 100, density=0.25)
    x, y = grid(1010, 1010, 80, 40)
    found = HostTerrain(with_land(bare, areas(low, high))).samples(x, y, cell_size=0.0).forest
    assert np.array_equal(found, np.where(x * UNIT < 1050.0, 1.0, 0.25))
    found = HostTerrain(with_land(bare, areas(high, low))).samples(x, y, cell_size=0.0).forest
    assert np.array_equal(found, np.where(x * UNIT < 1100.0, 1.0, 0.25))


def test_rings_are_even_odd(bare, context) -> None:
    """A bow-tie with lobes of two sizes, and a ring that is run through twice."""
    bow = [(1000, 1000), (1300, 1240), (1300, 1000), (1000, 1080)]
    lobes = shapely.unary_union(shapely.polygonize(list(shapely.node(shapely.LinearRing(bow)).geoms)))
    x, y = grid(990, 990, 320, 70)
    _, masks = Evaluator(with_land(bare, areas(([bow], {}))), context).points(x, y, cell_size=0.0)
    inside = shapely.contains_xy(lobes, x * UNIT, y * UNIT)
    near = shapely.distance(shapely.points(x * UNIT, y * UNIT), shapely.LinearRing(bow)) < 0.07
    assert np.array_equal(masks[~near, FOREST_MASK], inside[~near] * 1.0)
    twice = [np.array(SQUARE) * 100 + (1000, 1000)] * 2
    land = replace(areas((twice, {})), use=np.array([FOREST], np.uint8))
    _, masks = Evaluator(with_land(bare, land), context).points(x, y, cell_size=0.0)
    assert masks[:, FOREST_MASK].max() < 0.51  # the border itself


def test_vertices_on_borders_and_corners_of_tiles_have_one_value(bare, context) -> None:
    """Areas with edges along, and vertices on, the borders of tiles and of their parts."""
    level, side = 6, EXTENT / 64
    star = [(0, 0), (32, 16), (64, 0), (48, 32), (64, 64), (32, 48), (0, 64), (16, 32)]
    given = [
        ([np.array(star) / 64.0 * side * wide + np.array(at) * side], {"density": density})
        for wide, at, density in (
            (2, (20, 20), 1.0),
            (1, (23, 21), 0.8),
            (0.5, (24, 22), 0.6),
            (3, (21, 23), 0.4),
        )
    ]
    many = [
        square(*(np.array([i, j]) * 16.0 + 1664.0), 16.0, density=0.1 * (i + j))
        for i in range(4)
        for j in range(4)
    ]
    recipe = with_land(bare, areas(*given, *many))
    keys = [(column, row) for column in range(19, 28) for row in range(19, 28)]
    surface = assert_tiles_meet(Evaluator(recipe, context), level, keys, Evaluator(recipe, context))
    assert len(np.unique(surface.materials)) > 100


def test_culling_and_parts_of_blocks_change_no_bit(bare, context, monkeypatch) -> None:
    recipe = with_land(bare, partition(20, wide=12.0, use=FIELD))
    keys = [(12, 12), (15, 15), (16, 16), (18, 17), (19, 19)]
    expected, _ = Evaluator(recipe, context).tiles(keys, 6)
    for name, value in (("_CROWDED", 1e9), ("_CROWDED", 0), ("_PARTS", 7), ("_AT_ONCE", 64)):
        monkeypatch.setattr(f"sketchterrain.terrain.layers.landuse.{name}", value)
        found, _ = Evaluator(recipe, context).tiles(keys, 6)
        assert np.array_equal(found.materials, expected.materials), name
    everything = lambda index, blocks, least=0: tuple(  # noqa: E731
        np.indices((len(blocks), len(index))).reshape(2, -1)
    )
    monkeypatch.setattr(BoxIndex, "touching", everything)
    found, _ = Evaluator(recipe, context).tiles(keys, 6)
    assert np.array_equal(found.materials, expected.materials)


@each_other_device
def test_all_devices_compute_the_same_bits(bare, context, other) -> None:
    recipe, (x, y) = with_land(bare, SCENE), grid(950, 950, 700)
    results = [Evaluator(recipe, each) for each in (context, ComputeContext(other))]
    for cell in CELLS:
        one, two = (each.points(x, y, cell_size=cell)[1] for each in results)
        assert np.array_equal(one, two), cell
    one, two = (each.tiles([(16, 16), (20, 18)], 6)[0].materials for each in results)
    assert np.array_equal(one, two)


def test_no_height_changes_and_no_bit_beyond_areas(bare, context) -> None:
    one, two = (Evaluator(each, context) for each in (bare, with_land(bare, SCENE)))
    x, y = grid(700, 700, 1200, 120)
    box = boxes_of(SCENE)
    for cell in CELLS:
        (height, masks), (land_height, land_masks) = (
            each.points(x, y, cell_size=cell) for each in (one, two)
        )
        assert np.array_equal(height, land_height)
        changed = (masks != land_masks).any(axis=1)
        reach = 0.5 * cell + 0.01
        near = (x * UNIT > box[:, 0].min() - reach) & (x * UNIT < box[:, 2].max() + reach)
        near &= (y * UNIT > box[:, 1].min() - reach) & (y * UNIT < box[:, 3].max() + reach)
        assert changed.any()
        assert not (changed & ~near).any()


def test_narrow_areas_fade_out(bare, context) -> None:
    evaluator = Evaluator(with_land(bare, areas(square(1000, 1000, 32.0))), context)
    x, y = (np.full(1, round(1016.0 / UNIT)) for _ in range(2))
    found = [
        evaluator.points(x, y, cell_size=cell)[1][0, FOREST_MASK] for cell in (4.0, 8.0, 10.0, 13.0, 16.0)
    ]
    assert found[0] == found[1] == 1.0
    assert found[-1] == 0.0
    assert 1.0 > found[2] > found[3] > 0.0
    sliver = [(1000, 1000), (1400, 1000.5), (1000, 1001)]
    layer = LandUseLayer(MATERIALS, areas(([sliver], {})))
    assert len(layer.listed(np.array([[0, 0, 1 << 24, 1 << 24]]), 1.0, WORLD)[0]) == 0
    assert len(layer.listed(np.array([[0, 0, 1 << 24, 1 << 24]]), 0.1, WORLD)[0]) == 1


def test_materials_by_use_and_crop(bare, context) -> None:
    """Whole cells of a ploughed field are soil; roads and pads come later; none in a lake."""
    evaluator = Evaluator(with_land(bare, SCENE), context)

    def weights(at, material):
        axis = np.rint((np.arange(-1, 2) * 1.0)[None] / UNIT).astype(np.int64)
        x, y = (axis + round(each / UNIT) for each in at)
        return evaluator.surface(x, y[:, ::-1], cell_size=1.0).materials[0, 0, 0, MATERIALS.index(material)]

    assert weights((1350, 1200), "soil") > 0.99
    assert weights((1450, 1050), "grass") > 0.99
    assert 0.49 < weights((1550, 1050), "gravel") < 0.51
    assert weights((1115, 1065), "grass") > 0.99
    assert weights((1100, 1150), "forest_floor") > 0.5


def test_a_road_lies_on_a_field(make_recipe, context) -> None:
    land = areas(square(1000, 1000, 400, use=FIELD, crop=CROPS.index("ploughed")))
    road = sketch_with(("road", [(1050, 1200), (1350, 1200)], {"id": 1, "surface": "asphalt"}), extent=EXTENT)
    recipe = with_roads(road, with_land(make_recipe(ground={"relief": 10.0}), land))
    for cell in (1.0, 5.0):
        axis = np.rint((np.arange(-9, 10) * cell)[None] / UNIT).astype(np.int64) + round(1200.0 / UNIT)
        surface = Evaluator(recipe, context).surface(axis, axis[:, ::-1], cell_size=cell)
        asphalt, soil = (surface.materials[0, :, 8, MATERIALS.index(name)] for name in ("asphalt", "soil"))
        assert asphalt[8] > 0.99
        assert 0.0 < np.diff(asphalt).max() < 1.0
        assert np.abs(asphalt + soil - 1.0).max() < 0.005
        assert soil[[0, -1]].min() > 0.99


def test_no_field_is_in_water(make_recipe, context) -> None:
    recipe = with_land(
        make_recipe(lakes=(lake(2000, 2000, 80, 10.0, spacing=5.0),)),
        areas(square(1800, 1800, 400, use=FIELD, crop=CROPS.index("ploughed"))),
    )
    line = np.rint((np.arange(-60, 61) * 2.0)[None] / UNIT).astype(np.int64) + round(2000 / UNIT)
    surface = Evaluator(recipe, context).surface(line, line[:, ::-1], cell_size=2.0)
    soil = surface.materials[0, ..., MATERIALS.index("soil")]
    assert soil[59, 59] < 0.5
    assert soil[59, 2] > 0.99


def edited(rng: np.random.Generator, scene: list, number: int) -> list:
    """Return areas with one of them moved, removed, added, or given another property."""
    scene, place = list(scene), int(rng.integers(len(scene)))
    rings, own = scene[place]
    kind = number % 5
    if kind == 0:
        rings = [np.array(rings[0], np.float64) + rng.normal(0.0, 5.0, (len(rings[0]), 2)), *rings[1:]]
    elif kind == 1:
        own = own | {"use": int(rng.integers(4)), "density": 0.3}
    elif kind == 2:
        return [*scene[:place], *scene[place + 1 :]]
    elif kind == 3:
        return [*scene, square(*rng.uniform(1000, 1400, 2), 80.0, id=100 + number)]
    else:
        rings = [np.insert(np.array(rings[0], np.float64), 1, rng.uniform(1000, 1500, 2), axis=0)]
    scene[place] = (rings, own)
    return scene


def test_updates_equal_new_terrains_and_change_their_areas_only(bare, context) -> None:
    rng = np.random.default_rng(5)
    scene = [square(1000 + 60 * i, 1000 + 60 * j, 60, id=1 + i + 8 * j) for j in range(8) for i in range(8)]
    x, y = grid(980, 980, 540)
    old = Evaluator(with_land(bare, areas(*scene)), context)
    keys = [(c, r) for c in range(15, 24, 3) for r in range(15, 24, 3)]
    old.tiles(keys, 6)
    for number in range(10):
        scene = edited(rng, scene, number)
        recipe = with_land(bare, areas(*scene))
        new, boxes = old.updated(recipe)
        fresh = Evaluator(recipe, context)
        assert np.array_equal(new.tiles(keys, 6)[0].materials, fresh.tiles(keys, 6)[0].materials), number
        for cell in (0.0, 6.0):
            assert_changed_within(boxes, (new, fresh, old), x, y, cell, cell)
        old = new


def test_equal_areas_do_not_differ_and_many_changes_are_one_box(bare) -> None:
    one, two = partition(24), partition(24)
    assert changed_areas(with_land(bare, one), with_land(bare, two)) == []
    other = replace(one, density=np.full(len(one), 0.5))
    (box,) = changed_areas(with_land(bare, one), with_land(bare, other))
    every = boxes_of(one)
    assert np.allclose(box, [*every[:, :2].min(axis=0), *every[:, 2:].max(axis=0)], atol=0.01)


def test_plants_follow_land_use(bare, context) -> None:
    land = areas(
        square(1000, 1000, 200, use=FIELD, crop=CROPS.index("ploughed")),
        square(1200, 1000, 200, use=MEADOW),
        square(1000, 1200, 200, use=BUILT_UP),
        square(1200, 1200, 200, density=0.9, conifers=1.0),
        square(1400, 1200, 200, density=0.45, conifers=0.0),
        square(1400, 1000, 200, use=FIELD, crop=CROPS.index("orchard"), direction=30.0),
        square(1600, 1000, 200, use=FIELD, crop=CROPS.index("vineyard"), direction=90.0),
    )
    recipe = with_land(replace(bare, climate=dict(bare.climate) | {"tree_line": 5000.0}), land)
    sampler = FoliageSampler(Evaluator(recipe, context))
    plants = sampler.within((1000, 1000, 1600, 1400))
    trees = plants["species"] != SPECIES.index("shrub")

    def of(west, south, chosen=slice(None)):
        x, y = plants["x"], plants["y"]
        return plants[(x >= west) & (x < west + 200) & (y >= south) & (y < south + 200)]

    assert not len(of(1000, 1000))
    assert not len(of(1200, 1000))
    assert not len(of(1000, 1200))
    thick, thin = of(1200, 1200), of(1400, 1200)
    assert 1.5 < len(thick) / len(thin) < 3.5
    for stand, names in ((thick, ("spruce", "pine")), (thin, ("oak", "birch"))):
        own = stand[stand["species"] != SPECIES.index("shrub")]
        assert np.isin(own["species"], [SPECIES.index(name) for name in names]).all()
        assert len(own) > 200
    rows = of(1400, 1000)
    assert abs(len(rows) - 200 * 200 / 25) < 60
    across = (rows["x"] - 1400) * np.cos(np.radians(30)) - (rows["y"] - 1000) * np.sin(np.radians(30))
    assert np.abs((across / 5.0 - 0.225 + 0.5) % 1.0 - 0.5).max() < 1e-3
    vines = sampler.within((1600, 1000, 1800, 1200))
    assert abs(len(vines) - 200 * 200 / (2.2 * 1.8)) < 250
    assert (vines["species"] == SPECIES.index("shrub")).all()
    assert np.abs((-(vines["y"] - 1000) / 2.2 - 0.19 + 0.5) % 1.0 - 0.5).max() < 1e-3
    parts = [sampler.within((1400, 1000, 1500, 1200)), sampler.within((1500, 1000, 1600, 1200))]
    whole = sampler.within((1400, 1000, 1600, 1200))
    assert np.array_equal(np.sort(np.concatenate(parts), order=("x", "y")), np.sort(whole, order=("x", "y")))
    assert trees.any()
    tufts = sampler.within((1190, 1000, 1210, 1020), "grass")
    assert len(tufts) > 50
    assert (tufts["x"] >= 1200).all()
