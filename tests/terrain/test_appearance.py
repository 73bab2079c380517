"""Appearance tiles: shares of areas, edges and phases of marks, junctions, equal texels in all tiles."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import shapely

from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import FeatureTable
from sketchterrain.landuse.areas import NO_LAND_USE, land_use
from sketchterrain.roads.road_types import BRIDGE, RoadNetwork
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.terrain.appearance import SIDE, Appearance
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import WorldSettings
from sketchterrain.terrain.orthophotos import Orthophoto
from sketchterrain.terrain.painted_land import PaintedLand, painted_roads
from sketchterrain.terrain.recipe import TerrainRecipe

from .. import terrains
from ..sample_roads import make_road

EXTENT = 4096.0
MEADOW = 153  # 0.6: share of a meadow's texel that is painted
WHITE = np.sqrt(0.4)


def recipe_of(landuse, roads=()):
    layers = (LandUseLayer(MATERIALS, landuse),)
    return TerrainRecipe(WorldSettings(EXTENT, 0, 0.8), {}, layers, network=RoadNetwork(tuple(roads)))


def appearance(areas=(), roads=(), *, use="meadow", context=None, slope=(0.0, 0.0), **columns):
    landuse = NO_LAND_USE
    if len(areas):
        columns["use"] = (use,) * len(areas) if isinstance(use, str) else tuple(use)
        layer = FeatureTable.from_shapes("landuse", np.array(areas, object), columns=columns)
        landuse = land_use(Sketch(vectors={"landuse": layer}))

    def heights(x, y, *, cell_size):
        assert cell_size > 0
        return np.asarray(slope[0] * x + slope[1] * y, np.float32)

    return Appearance(PaintedLand(recipe_of(landuse, roads), context or terrains.context(), heights))


def partition(count, seed, *, size=1000.0, at=(300.0, 400.0)):
    """Return cells of random points in a square, which share their borders vertex by vertex."""
    rng = np.random.default_rng(seed)
    points = shapely.MultiPoint(rng.uniform(0.0, size, (count, 2)))
    square = shapely.box(0.0, 0.0, size, size)
    cells = shapely.get_parts(shapely.voronoi_polygons(points, extend_to=square))
    moved = shapely.transform(shapely.intersection(cells, square), lambda x: x + at)
    return shapely.set_precision(moved, 1.0 / 1024.0)


def texel_bounds(level, column, row):
    """Return west, south, east and north of a tile's texels, each (SIDE, SIDE), row 0 northernmost."""
    width, side = EXTENT / 2.0**level, EXTENT / 2.0**level / (SIDE - 2)
    west, north = np.meshgrid(
        column * width + (np.arange(SIDE) - 1.0) * side, (row + 1) * width - (np.arange(SIDE) - 1.0) * side
    )
    return np.stack([west, north - side, west + side, north])


def texels_within(key, west, south, east, north):
    """Return which texels of a tile lie in a rectangle."""
    own = texel_bounds(*key)
    return (own[0] >= west) & (own[1] >= south) & (own[2] <= east) & (own[3] <= north)


def shares_of(shape, boxes):
    """Return the exact shares of boxes (m) that a shape covers."""
    boxes = shapely.box(*boxes)
    return shapely.area(shapely.intersection(boxes, shape)) / shapely.area(boxes)


def test_shares_are_the_areas_of_texels_inside() -> None:
    """Of a ring with a hole that touches its border in a vertex, and of slivers."""
    ring = shapely.Point(800.0, 700.0).buffer(350.0, 12)
    corner = np.array(ring.exterior.coords[5])
    hole = shapely.Polygon(corner + np.array([(0, 0), (-90, -150), (60, -190)])).intersection(ring)
    far_hole = shapely.box(600.0, 500.0, 700.0, 680.0)
    sliver = shapely.Polygon([(1300.0, 200.0), (1900.0, 1100.0), (1900.4, 1100.0)])
    shapes = [ring.difference(hole).difference(far_hole), sliver]
    paint, whole = appearance(shapely.set_precision(shapes, 1.0 / 1024.0)), shapely.union_all(shapes)
    rng = np.random.default_rng(9)
    for level, place in itertools.product((-1, 0, 2, 5), ((820.0, 640.0), (1600.0, 650.0), tuple(corner))):
        key = (level, *(int(part // (EXTENT / 2.0**level)) for part in place))
        share = paint.tiles([key])[0, ..., 3]
        partly = np.argwhere((share > 0) & (share < MEADOW))
        near = tuple(np.concatenate([rng.integers(0, SIDE, (300, 2)), rng.permutation(partly)[:300]]).T)
        expected = shares_of(whole, texel_bounds(*key)[:, *near])
        assert np.abs(share[near] / MEADOW - expected).max() < 1.5 / 255.0, (level, place)


def test_the_higher_of_two_overlapping_areas_is_on_top() -> None:
    both = [shapely.box(100.0, 100.0, 300.0, 300.0), shapely.box(200.0, 200.0, 400.0, 400.0)]
    paint = appearance(both, use=["field", "built_up"])
    alone = appearance(both[1:], use="built_up")
    key = (5, 1, 1)
    (one,), (other,) = paint.tiles([key]), alone.tiles([key])
    inside = texels_within(key, *both[1].bounds)
    assert inside.sum() > 1000
    np.testing.assert_array_equal(one[inside][:, 3], other[inside][:, 3])
    share = one[..., 3][texels_within(key, 100.0, 100.0, 200.0, 300.0)]
    assert share.size > 1000
    assert (share > 150).all()


def test_no_tile_is_left_out_by_occupied() -> None:
    road = make_road([(1500, 1500, 0), (1700, 1640, 0), (1950, 1510, 0)])
    paint = appearance(partition(20, 6, size=300.0), [road])
    keys = np.array([(level, c, r) for level in (2, 4) for c in range(2**level) for r in range(2**level)])
    painted = paint.tiles(keys)[..., 3].any(axis=(1, 2))
    occupied = paint.occupied(keys)
    assert 0 < painted.sum() <= occupied.sum() < len(keys) // 3
    assert not (painted & ~occupied).any()


def straight(width=6.0, turn=0.0, **given):
    """Return a road of 600 m through the middle of the sketch, turned by an angle (°)."""
    ahead = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    middle = np.array([2048.0, 2048.0])
    ends = [np.append(middle - 300.0 * ahead, 0.0), np.append(middle + 300.0 * ahead, 0.0)]
    return make_road(ends, width=width, **given)


def marks(tile):
    """Return how white texels are, 0 … 1."""
    return (tile[..., :3] / 255.0).mean(axis=-1) > WHITE


def test_dashes_keep_their_phase_over_tiles() -> None:
    """One dash in 9 m from the leg's start on, within 1 mm, where they start and end at borders of tiles."""
    paint, level, row = appearance(roads=[straight()]), 14, 4 * 2048
    start = 1748  # of the leg, and of a tile of 0.25 m
    edges = [start + 9 * number + more for number in range(6, 40, 3) for more in (0, 3)]
    keys = [(level, column, row) for edge in edges for column in (4 * edge - 1, 4 * edge)]
    axis = marks(paint.tiles(keys))[:, -2, 1:-1].reshape(len(edges), -1)
    changes = np.diff(axis.astype(int), axis=1) != 0
    assert (changes.sum(axis=1) == 1).all()
    away = (np.argmax(changes, axis=1) + 1) * paint.texel(level) - 0.25
    assert np.abs(away).max() <= 1e-3


def test_edges_are_sharp_within_half_a_texel() -> None:
    """Surfaces cover texels as their outlines do."""
    key = (6, 32, 32)
    bounds = texel_bounds(*key)
    x, y = (bounds[:2] + bounds[2:]) / 2.0
    for turn in (0.0, 17.0, 45.0, 63.0):
        road = straight(turn=turn, shoulder=0.0)
        surface = shapely.LineString(road.axis[:, :2]).buffer(3.0, cap_style="flat")
        share = appearance(roads=[road]).tiles([key])[0, ..., 3] / 255.0
        away = shapely.distance(shapely.points(x, y), surface.boundary)
        expected = shapely.contains_xy(surface, x, y).astype(float)
        cut = away < x[0, 1] - x[0, 0]
        expected[cut] = shares_of(surface, bounds[:, cut])
        # Gravel frays beyond the edge of a road without shoulders, by less than 0.2 m.
        assert np.abs(share - expected)[away > 0.2].max() < 0.5, turn
        assert share[expected > 0.999].min() > 0.999, turn


def crossing(ways):
    """Return legs of 200 m that meet in the sketch's middle."""
    middle, legs = np.array([2048.0, 2048.0]), []
    for number, bearing in enumerate(ways):
        end = middle + 200.0 * np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))])
        points = [(*middle, 0.0), (*end, 0.0)]
        legs.append(make_road(points, vector=number + 1, ends=(len(ways), 1)))
    return legs


@pytest.mark.parametrize(
    ("ways", "stops"), [((90, 270, 0), 1), ((0, 90, 180, 270), 4), ((0, 100, 200, 250, 310), 5)]
)
def test_markings_follow_the_number_of_ways(ways, stops) -> None:
    """At a junction of three ways one gives way, at larger ones all (Bruneton & Neyret 2008, section 3.1)."""
    paint = appearance(roads=crossing(ways))
    window = marks(paint.window(2030.0, 2066.0, cell=(0.05, 0.05), columns=720, rows=720))
    x, y = np.meshgrid(2030.0 + 0.05 * np.arange(720), 2066.0 - 0.05 * np.arange(720))
    for number, bearing in enumerate(ways):
        ahead = np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))])
        u = (x - 2048.0) * ahead[0] + (y - 2048.0) * ahead[1]
        v = (x - 2048.0) * -ahead[1] + (y - 2048.0) * ahead[0]  # to the left of the way out
        # Who arrives keeps to the right, which is the left seen from the junction.
        line = (u > 3.0) & (u < 6.0)
        own = window & line & (v > 0.8) & (v < 2.2)
        other = window & line & (v < -0.8) & (v > -2.2)
        gives_way = len(ways) > 3 or number == 2
        assert own.any() == gives_way, (ways, number)
        assert len(ways) > 4 or not other.any()  # beside four ways or less nothing else is near
    centre = np.hypot(x - 2048.0, y - 2048.0) < 3.0
    assert not (window & centre).any()


def test_rails_lie_on_roads_and_roads_on_paths() -> None:
    east_west = ([(1900, 2048, 0), (2200, 2048, 0)], [(2048, 1900, 0), (2048, 2200, 0)])
    road = make_road(east_west[0])
    path = make_road(east_west[1], vector=2, layer="path", width=2.0, shoulder=0.2)
    path = replace(path, works=path.works._replace(surface="soil"))
    alone, both = appearance(roads=[road]), appearance(roads=[road, path])
    grid = {"cell": (0.1, 0.1), "columns": 40, "rows": 40}
    at_crossing = (2046.0, 2050.0)
    np.testing.assert_array_equal(alone.window(*at_crossing, **grid), both.window(*at_crossing, **grid))
    rails = make_road(east_west[1], vector=2, layer="railway", width=4.4, shoulder=0.6)
    with_rails = appearance(roads=[road, rails]).window(*at_crossing, **grid)
    np.testing.assert_array_equal(with_rails, appearance(roads=[rails]).window(*at_crossing, **grid))


def test_fields_are_ploughed_along_contours_and_else_along_their_longest_side() -> None:
    """Rows are seen as variation across them, not along them."""
    field = shapely.box(500.0, 500.0, 900.0, 700.0)
    for slope, across in (((0.0, 0.0), 0), ((0.2, 0.0), 1), ((0.0, 0.2), 0), ((0.02, 0.02), 0)):
        paint = appearance([field], use="field", crop=("ploughed",), slope=slope)
        window = paint.window(690.0, 610.0, cell=(0.1, 0.1), columns=100, rows=100)[..., :3].mean(axis=-1)
        varied = [np.abs(np.diff(window, axis=axis)).mean() for axis in (0, 1)]
        assert np.argmax(varied) == across, slope
        assert max(varied) > 4 * min(varied)


def test_parcels_divide_a_field_into_strips() -> None:
    """Across its rows, so many metres wide; those of an automatic field have crops of their own."""
    field = shapely.box(500.0, 500.0, 1100.0, 700.0)
    seen = {}
    for crop in ("automatic", "maize"):
        paint = appearance(
            [field], use="field", crop=(crop,), direction=np.array([0.0]), parcels=np.array([50.0])
        )
        window = paint.window(502.5, 600.0, cell=(5.0, 5.0), columns=119, rows=1)[0, :, :3].astype(float)
        strips = window[:-9].reshape(11, 10, 3)
        assert np.ptp(strips[:, 2:8], axis=1).max() < 40  # even within
        seen[crop] = len(np.unique(np.rint(strips[:, 2:8].mean(axis=1) / 12.0), axis=0))
        alone = appearance([field], use="field", crop=(crop,), direction=np.array([0.0]))
        plain = alone.window(502.5, 600.0, cell=(5.0, 5.0), columns=119, rows=1)[0, :, :3].astype(float)
        assert np.abs(plain - window).max() > 4
    assert seen["automatic"] > max(seen["maize"], 2)


def test_double_precision_agrees(double_context) -> None:
    areas, use = partition(60, 2), ["field", "meadow", "built_up", "forest"] * 15
    roads = [make_road([(300, 420, 0), (700, 640, 0), (1100, 1300, 0)], width=7.0)]
    single, double = (appearance(areas, roads, use=use, context=each) for each in (None, double_context))
    keys = [(3, 1, 1), (8, 43, 40), (11, 350, 320), (0, 0, 0)]
    one, other = single.tiles(keys).astype(int), double.tiles(keys).astype(int)
    off = np.abs(one - other)
    assert (off > 1).mean() < 1e-3
    assert (off[..., 3] > 8).mean() < 1e-4


def test_texels_far_from_the_origin_are_as_exact() -> None:
    near, far = np.array([1000.0, 1000.0]), np.array([9_000_000.0, -9_000_000.0])
    square = shapely.box(-50.0, -30.0, 40.0, 60.0)
    shares = []
    for at in (near, far):
        paint = appearance([shapely.transform(square, lambda x, at=at: x + at)])
        west, north = at + np.array([-60.03, 70.02])
        shares.append(paint.window(west, north, cell=(0.5, 0.5), columns=250, rows=250)[..., 3].astype(int))
    assert shares[0].max() == MEADOW
    assert np.abs(shares[0] - shares[1]).max() <= 1


def test_an_edit_gives_the_texels_of_a_new_appearance() -> None:
    """Outside of the areas that it reports no texel changes."""
    areas = partition(80, 3)
    roads = crossing((90, 270, 0))
    before = appearance(areas, roads, use="field")
    level = 4
    keys = [(level, c, r) for c in range(1, 10) for r in range(1, 10)]
    old = before.tiles(keys)
    moved = [areas[7], *areas[1:]]
    turned = [roads[0], *crossing((90, 270, 30))[1:]]
    for new_areas, new_roads in ((moved, turned), (areas[:-3], crossing((0, 90, 180, 270)))):
        fresh = appearance(new_areas, new_roads, use="field")
        edited = before.updated(fresh.land.recipe, before.land.heights)
        found = edited.tiles(keys)
        np.testing.assert_array_equal(found, fresh.tiles(keys))
        boxes, reach = edited.changed_areas(before), edited.reach(before)
        assert reach == 1.0
        corner = np.array(keys)[:, 1:] * EXTENT / 2**level
        texel = before.texel(level)
        low, high = corner - texel, corner + EXTENT / 2**level + texel
        touched = ((low[:, None] <= boxes[:, 2:]) & (high[:, None] >= boxes[:, :2])).all(axis=-1).any(axis=-1)
        changed = (found != old).any(axis=(1, 2, 3))
        assert changed.any()
        assert not (changed & ~touched).any()
        assert touched.sum() < len(keys) // 2


def test_pieces_of_roads_after_edits_are_those_of_new_ones() -> None:
    rng = np.random.default_rng(2)
    roads = [road for number in range(60) for road in street(rng, number)]
    before = painted_roads(RoadNetwork(tuple(roads)), EXTENT)
    blocks = np.array([[0, 0, 1 << 22, 1 << 22], [1 << 22, 1 << 20, 1 << 23, 1 << 23]])
    for _ in range(8):
        number = int(rng.integers(60))
        roads = [road for road in roads if road.leg != number or rng.random() < 0.2]
        roads = sorted([*roads, *street(rng, 100 + number)], key=lambda road: road.leg)
        network = RoadNetwork(tuple(roads))
        edited, fresh = painted_roads(network, EXTENT, before), painted_roads(network, EXTENT)
        for name in ("at", "row", "half_width"):
            np.testing.assert_array_equal(getattr(edited, name), getattr(fresh, name))
        np.testing.assert_array_equal(edited.boxes.boxes, fresh.boxes.boxes)
        np.testing.assert_array_equal(edited.boxes.touching(blocks), fresh.boxes.touching(blocks))
        assert 0 < len(edited.without(before)) < len(edited.at) // 2
        before = edited


def street(rng, number):
    """Return the two parts of a leg, the second one a bridge."""
    x, y = rng.uniform(100.0, 3900.0, 2)
    points = np.array([[x + 30.0 * k, y + 5.0 * k * k, 0.0] for k in range(4)])
    given = {"vector": number, "leg": number}
    return make_road(points, **given), make_road(points[2:] + 60.0, part=1, structure=BRIDGE, **given)


def test_photographs_lie_beneath_what_is_painted() -> None:
    """Their pixels are those of the texels, at the finest and at coarser levels, and roads lie on them."""
    pixels = np.zeros((64, 128, 4), np.uint8)
    pixels[:, :64] = (255, 0, 0, 255)
    pixels[:32, 64:] = (0, 0, 255, 255)  # the south-east is transparent
    photo = Orthophoto(pixels, (1000.0, 1000.0, 2280.0, 1640.0))
    paint = appearance(roads=[make_road([(900, 1320, 0), (2400, 1320, 0)], shoulder=0.0)])
    paint = paint.updated(replace(paint.land.recipe, orthophotos=(photo,)), paint.land.heights)
    for texel in (5.0, 40.0):
        window = paint.window(
            900.0, 1700.0, cell=(texel, texel), columns=int(1500 / texel), rows=int(800 / texel)
        )
        x = 900.0 + texel * np.arange(window.shape[1])
        y = (1700.0 - texel * np.arange(window.shape[0]))[:, None]
        road = np.abs(y - 1320.0) < 4.0 + texel
        inner = (x > 1000 + texel) & (y > 1000 + texel) & (y < 1640 - texel) & ~road
        red = inner & (x < 1640 - 2 * texel)
        blue = inner & (x > 1640 + 2 * texel) & (x < 2280 - texel) & (y > 1320 + texel)
        assert red.any()
        assert blue.any()
        assert (window[red][:, [0, 3]] > [180, 250]).all()
        assert (window[red][:, 1:3] < 5).all()
        assert (window[blue][:, 2:] > [180, 250]).all()
        clear = (x > 1640 + 2 * texel) & (y < 1320 - 2 * texel)
        assert (window[clear][:, 3] < 5).all()
    on_road = paint.window(1500.0, 1320.3, cell=(0.5, 0.5), columns=10, rows=2)
    assert (on_road[..., 0] < 110).all()
    assert paint.occupied([(4, 4, 4), (4, 15, 15)]).tolist() == [True, False]
