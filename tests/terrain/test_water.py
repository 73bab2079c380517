"""Lakes hold water, beds never rise, banks hold, valleys cut mountains; covers match their paint."""

import itertools
from typing import Any

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.geometry.splines import catmull_rom
from sketchterrain.landforms.placement.feature_types import Cover, Lake, River, ShapeField, distance_inside
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.terrain.centrelines import TOLERANCE_CELLS, nearest_on_arc, tolerance_cell
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.layers.corridors import ARC, CorridorsLayer
from sketchterrain.terrain.layers.layer import MASKS
from sketchterrain.terrain.recipe import TerrainRecipe
from tests import terrains

from .conftest import heights_at, river_of, round_field, tiers
from .conftest import lake as round_lake

EXTENT = 4096.0
CENTRE = 2048.0


def field(radius: float, *, x: float = CENTRE) -> ShapeField:
    return round_field(x, CENTRE, radius)


def lake(radius: float, level: float, *, x: float = CENTRE) -> Lake:
    return round_lake(x, CENTRE, radius, level)


def straight(*, x: tuple[float, float], z: tuple[float, float], width: float = 14.0) -> River:
    """A straight river through the middle of the ground, west to east or back."""
    at = np.linspace(*x, 200)
    return river_of(np.column_stack([at, np.full(200, CENTRE), np.linspace(*z, 200)]), width)


def test_a_lake_holds_its_water(make_recipe, context) -> None:
    """On any terrain: water inside the shore, and flooding from it never gets out."""
    step = np.arange(-500, 501, 2.0)
    radius = np.hypot(step, step[:, None])
    for level in (-25.0, 0.0, 25.0):
        recipe = make_recipe(lakes=(lake(300, level),))
        ground = heights_at(recipe, context, CENTRE + step, CENTRE + step[:, None])
        assert (ground[radius < 298] < level).all()
        assert (ground[(radius > 302) & (radius < 314)] > level).all()
        np.testing.assert_allclose(level - ground[radius < 200].min(), 8, atol=1e-3)
        regions, _ = ndimage.label(ground <= level)
        flooded = regions == regions[250, 250]
        assert radius[flooded].max() < 302, level


def test_beyond_its_margin_a_lake_changes_no_bit(make_recipe, context) -> None:
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, EXTENT, (2, 20000))
    outside = np.hypot(x - CENTRE, y - CENTRE) > 400
    bare = heights_at(make_recipe(), context, x, y)
    wet = heights_at(make_recipe(lakes=(lake(300, 40.0),)), context, x, y)
    np.testing.assert_array_equal(bare[outside], wet[outside])
    assert (bare != wet)[~outside].mean() > 0.9


def test_small_lakes_fade_with_the_cell_size(make_recipe, context) -> None:
    recipe = make_recipe(lakes=(lake(30, 30.0),))
    wet, dry = (
        [float(heights_at(each, context, CENTRE, CENTRE, cell)) for cell in (28, 40, 50, 61, 200)]
        for each in (recipe, make_recipe())
    )
    effect = np.abs(np.subtract(wet, dry)).tolist()
    assert effect[0] > 5
    assert effect == sorted(effect, reverse=True)
    assert effect[-2:] == [0, 0]


@pytest.mark.parametrize("inward", [True, False])
def test_a_river_enters_and_leaves_without_a_dam(make_recipe, context, inward) -> None:
    """Water flows freely between the lake and open country, and the lake keeps its depth."""
    level = 6.0
    if inward:
        stream = straight(x=(500.0, 1800.0), z=(14.0, level))
    else:
        stream = straight(x=(1800.0, 500.0), z=(level, -2.0))
    still = make_recipe(lakes=(lake(300, level),))
    running = make_recipe(lakes=(lake(300, level),), rivers=(stream,))
    x, line = np.arange(520.0, 1800.0), stream.centreline[np.argsort(stream.centreline[:, 0])]
    assert (heights_at(running, context, x, CENTRE) < np.interp(x, *line[:, [0, 2]].T)).all()
    step = np.arange(-298, 299, 2.0)
    inside = np.hypot(step, step[:, None]) < 298
    before = heights_at(still, context, CENTRE + step, CENTRE + step[:, None])
    after = heights_at(running, context, CENTRE + step, CENTRE + step[:, None])
    assert (after - before)[inside].max() < 1e-4
    assert (after[inside] < level).all()


def test_the_nearer_of_two_lakes_wins(make_recipe, context) -> None:
    """Two levels a hundred metres apart: each keeps its water, a ridge between them."""
    pair = (lake(200, 5.0, x=CENTRE - 240), lake(200, 9.0, x=CENTRE + 240))
    line = np.arange(CENTRE - 430, CENTRE + 430)
    ground = heights_at(make_recipe(lakes=pair), context, line, CENTRE)
    assert (ground[np.abs(line - CENTRE + 240) < 190] < 5).all()
    assert (ground[np.abs(line - CENTRE - 240) < 190] < 9).all()
    assert ground[np.abs(line - CENTRE) < 30].max() > 9
    swapped = heights_at(make_recipe(lakes=pair[::-1]), context, line, CENTRE)
    np.testing.assert_allclose(swapped, ground, atol=1e-4)


def materials(recipe: TerrainRecipe, context: ComputeContext, radius: float) -> tuple[Any, Any]:
    """Weights on a grid around the centre, and each vertex's distance from it."""
    step = np.linspace(-radius, radius, 131)
    axis = to_lattice(CENTRE + step, EXTENT)[None]
    surface = Evaluator(recipe, context).surface(axis, axis[:, ::-1], cell_size=2 * radius / 130)
    return surface.materials[0], np.hypot(step, step[:, None])[1:-1, 1:-1]


def test_a_cover_has_its_weight(make_recipe, context) -> None:
    snow = MATERIALS.index("snow")
    bare, _ = materials(make_recipe(), context, 200.0)
    for strength in (1.0, 0.4):
        recipe = make_recipe(covers=(Cover(1, 1, field(120), snow, strength),))
        weights, distance = materials(recipe, context, 200.0)
        under = bare[distance < 100] * (1 - strength) + strength * np.eye(len(MATERIALS))[snow]
        np.testing.assert_allclose(weights.sum(axis=-1), 1, atol=1e-6)
        np.testing.assert_allclose(weights[distance < 100, snow], strength, atol=1e-5)
        np.testing.assert_allclose(weights[distance < 100], under, atol=1e-6)
        np.testing.assert_array_equal(weights[distance > 140], bare[distance > 140])


def test_sand_mud_and_grass_share_a_lakes_shore_and_its_bed_is_not_grass(make_recipe, context) -> None:
    weights, distance = materials(make_recipe(lakes=(lake(120, 10.0),)), context, 200.0)
    shore = (distance > 120.5) & (distance < 122.5)
    for material in ("sand", "soil", "grass"):
        assert weights[shore, MATERIALS.index(material)].max() > 0.6, material
        assert weights[shore, MATERIALS.index(material)].mean() < 0.6, material
    grass = weights[..., MATERIALS.index("grass")]
    meadow = grass + sum(weights[..., MATERIALS.index(name)] for name in ("dry_grass", "heath"))
    assert meadow[(distance > 127) & (distance < 140)].mean() > 0.7  # plants grow close to the water
    reeds = grass[(distance > 116) & (distance < 119)]
    assert reeds.max() > 0.7
    assert reeds.min() < 0.01
    assert weights[distance < 100, MATERIALS.index("river_bed")].min() > 0.9


RISE_M = 0.01
STREAM_RISE_M = 0.3  # of the bed, where a narrow one joins; water never rises
SIDE = 192
ROW, COLUMN = np.mgrid[:SIDE, :SIDE]


def every_metre(river: River) -> tuple[np.ndarray, np.ndarray]:
    """Return metres from the source, and (x, y, level, width) there."""
    line = np.column_stack([river.centreline, river.centreline_width])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    at = np.append(np.arange(0.0, arc[-1], 1.0), arc[-1])
    return at, np.stack([np.interp(at, arc, line[:, i]) for i in range(4)], axis=-1)


def depth_in_lakes(terrain: Terrain, places: np.ndarray) -> np.ndarray:
    """Return the distance inside the nearest lake (m); negative outside."""
    distances = [distance_inside(lake.shape, places) for lake in terrain.recipe.lakes]
    return np.max(distances, axis=0) if distances else np.full(len(places), -np.inf)


def greatest_rise(terrain: Terrain, river: River) -> float:
    """Return the greatest rise of the bed (m) above a point upstream, outside lakes."""
    _, line = every_metre(river)
    dry = line[depth_in_lakes(terrain, line[:, :2]) <= 0.0]
    if not len(dry):
        return 0.0
    bed = terrain.heights(dry[:, 0], dry[:, 1]).astype(np.float64)
    return float((bed - np.minimum.accumulate(bed)).max())


def lowest_bank(terrain: Terrain, river: River) -> float:
    """Return the height (m) over the water of the terrain 1.5 widths beside it, away from other water."""
    at, line = every_metre(river)
    width = line[:, 3]
    free = (at > 3 * width) & (at[-1] - at > 3 * width)
    free &= depth_in_lakes(terrain, line[:, :2]) < -4 * width.max()
    for other in terrain.recipe.rivers:
        if other is not river:
            wider = np.maximum(width, other.centreline_width.max())
            free &= cKDTree(every_metre(other)[1][:, :2]).query(line[:, :2])[0] > 3 * wider + 1.5 * width
    along = np.gradient(line[:, :2], axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.hypot(*along.T)[:, None]
    own, lowest = cKDTree(line[:, :2]), np.inf
    for side in (-1.5, 1.5):
        places = line[free, :2] + side * width[free, None] * across[free]
        if len(places):
            above = terrain.heights(places[:, 0], places[:, 1]) - line[free, 2]
            same_stretch = np.abs(at[own.query(places)[1]] - at[free]) <= 3 * width[free]
            lowest = min(lowest, float(above[same_stretch].min(initial=np.inf)))
    return lowest


def assert_water_stays(terrain: Terrain) -> None:
    for river in terrain.recipe.rivers:
        assert greatest_rise(terrain, river) <= (RISE_M if river.label else STREAM_RISE_M)
        assert lowest_bank(terrain, river) > 0


def stroke(picture: np.ndarray, points: list[np.ndarray], half: float, label: int) -> None:
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        dx, dy = x1 - x0, y1 - y0
        t = np.clip(((COLUMN - x0) * dx + (ROW - y0) * dy) / max(dx * dx + dy * dy, 1e-9), 0, 1)
        picture[np.hypot(COLUMN - x0 - t * dx, ROW - y0 - t * dy) <= half] = label


def wander(rng: np.random.Generator, start: np.ndarray) -> list[np.ndarray]:
    points, heading = [np.array(start, float)], rng.uniform(0, 2 * np.pi)
    for _ in range(rng.integers(3, 14)):
        heading += rng.normal(0, 0.6)
        points.append(points[-1] + SIDE / 14 * np.array([np.cos(heading), np.sin(heading)]))
    return points


def discs(rng: np.random.Generator, most: int, largest: float) -> np.ndarray:
    picture = np.zeros((SIDE, SIDE), np.uint8)
    for _ in range(rng.integers(0, most)):
        x, y = rng.uniform(0, SIDE, 2)
        picture[np.hypot(COLUMN - x, ROW - y) < rng.uniform(0.03, largest) * SIDE] = 1
    return picture


def random_sketch(seed: int) -> Sketch:
    """Strokes that branch, loop, cross mountains and lakes and run off the edge."""
    rng = np.random.default_rng(seed)
    river = np.zeros((SIDE, SIDE), np.uint8)
    for _ in range(rng.integers(1, 4)):
        points = wander(rng, rng.uniform(0.05, 0.95, 2) * SIDE)
        stroke(river, points, rng.uniform(0.6, 3.5), rng.integers(1, 4))
        for _ in range(rng.integers(0, 3)):
            branch = wander(rng, points[rng.integers(len(points))])
            stroke(river, branch, rng.uniform(0.6, 2), rng.integers(1, 4))
    if rng.random() < 0.3:
        x, y = rng.uniform(0.3, 0.7, 2) * SIDE
        river[np.abs(np.hypot(COLUMN - x, ROW - y) - rng.uniform(0.08, 0.25) * SIDE) < 1.8] = 1
    labels = {}
    for k in (1, 2, 3):
        width, depth = rng.choice([2, 5, 12, 30, 80]), rng.choice([0.5, 2, 4, 8])
        labels["river", k] = {"width": float(width), "depth": float(depth)}
    height, multitude = rng.choice([150, 400, 900]), rng.integers(1, 5)
    labels["mountain", 1] = {"height": float(height), "multitude": int(multitude)}
    return Sketch(
        extent=float(rng.choice([2000, 5000, 12000])),
        seed=seed,
        layers={
            "river": river,
            "mountain": discs(rng, 4, 0.2),
            "hill": discs(rng, 3, 0.2),
            "lake": discs(rng, 3, 0.1),
        },
        labels={**labels, ("hill", 1): {"height": 60.0, "multitude": 5}},
        ground={"relief": float(rng.choice([10, 60, 200]))},
        density={"mountain": 0.03, "hill": 0.3},
    )


# Regressions: beds at joints and in sharp bends, water beside lakes and in sharp bends.
@tiers("seed", [205], [0, 100, 115, 130, 172, 175, 287], range(1, 40))
def test_no_bed_rises_and_every_bank_holds(seed, context) -> None:
    terrain = build(random_sketch(seed), device=context)
    assert_water_stays(terrain)


@pytest.mark.parametrize(("extent", "seed"), [(600.0, 0), (1000.0, 1)])
def test_a_brook_narrower_than_its_stem_is_deep_builds_no_walls(extent, seed, context) -> None:
    """Its bed is under its water, also narrower than four of the finest cells, and it raises no other bed."""
    layers = {name: np.zeros((96, 96), np.uint8) for name in ("river", "lake")}
    layers["river"][60:63] = 1
    layers["lake"][np.hypot(*(np.mgrid[:96, :96] - np.array([30, 48])[:, None, None])) < 9] = 1
    labels = {("river", 1): {"width": 20.0, "depth": 6.0}}
    terrain = build(Sketch(extent=extent, seed=seed, layers=layers, labels=labels), device=context)
    stem, *brooks = terrain.recipe.rivers
    assert brooks
    for each in brooks:
        line = each.centreline
        assert (terrain.heights(line[:, 0], line[:, 1]) - line[:, 2]).max() < 0.0
    layer = terrain.recipe[CorridorsLayer]
    without = terrain.recipe.with_layers([CorridorsLayer(layer.courses[:1])])
    near = stem.centreline[cKDTree(stem.centreline[:, :2]).query(brooks[0].centreline[-1, :2])[1], :2]
    at = near + np.stack(np.meshgrid(*2 * [np.arange(-15.0, 15.0, 0.1)]), axis=-1).reshape(-1, 2)
    at = at[cKDTree(every_metre(stem)[1][:, :2]).query(at)[0] < 6.0]
    lattice = to_lattice(at, extent).T
    bed, own = (
        Evaluator(each, context).points(*lattice, cell_size=0.0)[0] for each in (terrain.recipe, without)
    )
    assert (bed - own).max() < 0.1


@tiers("poses", [range(1)], [range(1, 12)], [range(12, 100)])
def test_a_river_across_a_mountain_runs_below_the_straight_line(poses, context) -> None:
    """In random poses: the bed on the mountain is not above the line between its ends."""
    for pose in poses:
        rng = np.random.default_rng(pose)
        centre, angle = rng.uniform(0.4, 0.6, 2) * SIDE, rng.uniform(0, np.pi)
        radius, offset = rng.uniform(0.1, 0.2) * SIDE, rng.uniform(-0.08, 0.08) * SIDE
        ahead = np.array([np.cos(angle), np.sin(angle)])
        middle = centre + offset * np.array([-ahead[1], ahead[0]])
        river = np.zeros((SIDE, SIDE), np.uint8)
        stroke(river, [middle - 0.36 * SIDE * ahead, middle + 0.36 * SIDE * ahead], 1.5, 1)
        mountain = (np.hypot(COLUMN - centre[0], ROW - centre[1]) < radius).astype(np.uint8)
        layers, height = {"river": river, "mountain": mountain}, float(rng.uniform(100, 700))
        labels = {("mountain", 1): {"height": height}}
        dry = {"aridity": 1.0}  # hardly any streams
        sketch = Sketch(extent=6000.0, seed=pose, layers=layers, labels=labels, climate=dry)
        terrain = build(sketch, device=context)
        (found,) = (river for river in terrain.recipe.rivers if river.label)
        # The line from the point of the centreline before the mountain to that after it.
        x, y = found.centreline[:, 0], found.centreline[:, 1]
        row = np.clip((SIDE - y / sketch.pixel_size).astype(int), 0, SIDE - 1)
        column = np.clip((x / sketch.pixel_size).astype(int), 0, SIDE - 1)
        first, last = np.flatnonzero(mountain[row, column])[[0, -1]] + (-1, 1)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        at = np.linspace(arc[first], arc[last], int(arc[last] - arc[first]) + 2)
        bed = terrain.heights(np.interp(at, arc, x), np.interp(at, arc, y)).astype(np.float64)
        straight = np.linspace(bed[0], bed[-1], len(bed))
        assert (bed - straight).max() <= RISE_M
        assert any("crosses mountain 1: valley cut" in each.line for each in terrain.recipe.resolutions)


def test_a_river_ends_in_a_lake_at_its_level(context) -> None:
    river, lake = np.zeros((2, SIDE, SIDE), np.uint8)
    stroke(river, [np.array([90.0, 30.0]), np.array([100.0, 118.0])], 1.5, 1)
    lake[np.hypot(COLUMN - 102, ROW - 140) < 20] = 1
    terrain = build(Sketch(extent=4000.0, seed=3, layers={"river": river, "lake": lake}), device=context)
    (water,) = terrain.recipe.lakes
    (found,) = (river for river in terrain.recipe.rivers if river.label)
    assert distance_inside(water.shape, found.centreline[-1:, :2])[0] > 0
    assert found.centreline[-1, 2] == pytest.approx(water.level, abs=0.05)
    (resolution,) = terrain.recipe.resolutions
    assert resolution.line == f"river 1 ends in lake 1: water at {water.level:.1f} m"
    assert distance_inside(water.shape, np.array([[resolution.x, resolution.y]]))[0] > 0
    assert greatest_rise(terrain, found) <= RISE_M


def test_a_lake_in_a_mountain_is_a_tarn_with_a_rim(context) -> None:
    mountain = (np.hypot(COLUMN - 96, ROW - 96) < 60).astype(np.uint8)
    lake = (np.hypot(COLUMN - 120, ROW - 96) < 9).astype(np.uint8)
    terrain = build(Sketch(extent=5000.0, layers={"mountain": mountain, "lake": lake}), device=context)
    (tarn,) = terrain.recipe.lakes
    (resolution,) = terrain.recipe.resolutions
    assert resolution.line == f"lake 1 lies in mountain 1: a tarn at {tarn.level:.0f} m"
    assert distance_inside(tarn.shape, np.array([[resolution.x, resolution.y]]))[0] > 0
    angle, pixel = np.linspace(0, 2 * np.pi, 200), 5000.0 / SIDE
    middle = np.array([120.5, SIDE - 96.5]) * pixel
    around = middle + 11 * pixel * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    outlet = cKDTree(np.concatenate([each.centreline[:, :2] for each in terrain.recipe.rivers]))
    away = outlet.query(around)[0] > 80.0
    assert away.mean() > 0.6
    assert terrain.heights(*around[away].T).min() > tarn.level
    assert terrain.heights(*middle) < tarn.level


def river(points: list[tuple[float, float]], *, width: float, fall: float = 0.01) -> River:
    """A spline through points, with samples at every 40th of its segments."""
    controls = np.array(points, float)
    u = np.arange(40 * (len(controls) - 1) + 1) / 40.0
    curve = catmull_rom(controls, u)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(curve, axis=0).T))])
    return river_of(np.column_stack([curve, 20.0 - fall * arc]), width, every=40)


def hairpin(gap: float) -> list[tuple[float, float]]:
    side = gap / 2
    there = [(1500.0 + 120 * k, 2000.0 - side) for k in range(5)]
    return [*there, (2100.0, 2000.0), *((x, 2000.0 + side) for x, _ in reversed(there))]


def ground(evaluator: Evaluator, places: np.ndarray, cell_size: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return heights and the water mask at points (m)."""
    x, y = to_lattice(places, evaluator.recipe.extent).T
    height, masks = evaluator.points(x, y, cell_size=cell_size)
    return height.astype(np.float64), masks[:, MASKS.index("water")]


def assert_continuous(evaluator: Evaluator, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Ten times finer steps give about a tenth of the difference."""
    largest = []
    for count in (601, 6001):
        height, water = ground(evaluator, np.linspace(start, end, count))
        largest.append([np.abs(np.diff(height)).max(), np.abs(np.diff(water)).max()])
    assert np.all(np.array(largest[1]) < 0.16 * np.array(largest[0]) + 1e-3)


@tiers(
    ("gap", "width"), [(40.0, 10.0), (6.0, 40.0)], [(6.0, 10.0), (300.0, 10.0), (40.0, 40.0), (300.0, 40.0)]
)
def test_no_discontinuity_between_equally_near_branches(gap, width, make_recipe, double_context) -> None:
    """In a hairpin narrower or wider than its river."""
    evaluator = Evaluator(make_recipe(rivers=(river(hairpin(gap), width=width),)), double_context)
    for x in (1600.0, 1900.0, 2050.0, 2150.0):
        assert_continuous(evaluator, (x, 2000.0 - gap), (x, 2000.0 + gap))
    # Along the middle both branches are as far, and one is higher.
    assert_continuous(evaluator, (1520.0, 2000.0), (2160.0, 2000.0))


def test_no_discontinuity_at_a_confluence(make_recipe, double_context) -> None:
    main = river([(1400.0 + 150 * k, 2000.0) for k in range(9)], width=24.0)
    end = main.centreline[160]
    other = river([(1550.0, 2300.0), (1700.0, 2220.0), (1900.0, 2090.0), (end[0], end[1])], width=9.0)
    other.centreline[:, 2] += end[2] - other.centreline[-1, 2]
    evaluator = Evaluator(make_recipe(rivers=(main, other)), double_context)
    for x in np.linspace(1850.0, 2080.0, 12):
        assert_continuous(evaluator, (x, 1960.0), (x, 2160.0))


def test_a_river_narrower_than_two_cells_has_no_channel(make_recipe, context) -> None:
    for width in (3.0, 10.0, 30.0):
        course = river([(1400.0 + 150 * k, 2000.0 + 40 * (-1) ** k) for k in range(9)], width=width)
        evaluator = Evaluator(make_recipe(rivers=(course,)), context)
        line = course.centreline[60:-60, :2]
        along = np.gradient(line, axis=0)
        across = width * np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.hypot(*along.T)[:, None]
        for cells in (0.25, 0.6, 1.0, 1.5, 1.99, 2.5, 4.0, 8.0):
            bed, water = ground(evaluator, line, width / cells)
            banks = [ground(evaluator, line + side * across, width / cells)[0] for side in (-1.0, 1.0)]
            deep = np.minimum(*banks) - bed
            if cells < 2.0:
                assert np.abs(deep).max() < 0.02 * width  # the floodplain's slope, levels beside a bend
            if cells >= 4.0:
                assert deep.min() > 2.9  # 2 m of water, 1 m of bank
            assert water.min() > 0.99, (width, cells)


@tiers(
    ("name", "samples"),
    [("valley_river", 10)],
    [("alpine_range", 40)],
)
def test_arcs_stay_within_a_hundredth_of_a_cell_of_the_spline(name, samples) -> None:
    recipe = terrains.preset(name).recipe
    unit = metres_per_unit(recipe.extent)
    courses = sorted(
        recipe[CorridorsLayer].courses, key=lambda each: (not each.river.label, len(each.pieces))
    )
    painted = sum(each.river.label > 0 for each in courses)
    layer = CorridorsLayer(tuple(courses[: painted + 2]))  # two short streams
    # The ends of a shortened course are not the spline through the control points that are left.
    controls = [each.points[:, :2] for each in layer.rivers]
    inner = [catmull_rom(c, np.linspace(2, len(c) - 3, samples * len(c))) for c in controls]
    curves = [
        np.concatenate([curve, each.centreline[:, :2]])
        for curve, each in zip(inner, layer.rivers, strict=True)
    ]
    counts = []
    for cell in (*TOLERANCE_CELLS[::3], 3.0, 1000.0):
        packed = layer.arcs(recipe.extent, cell)
        shown = [not each.is_hidden(tolerance_cell(cell)) for each in layer.courses]
        curve = np.concatenate(list(itertools.compress(curves, shown)))
        counts.append(len(packed.start))
        square = np.full(len(curve), np.inf)
        for start, chord, arc in zip(packed.start * unit, packed.chord, packed.arc, strict=True):
            square = np.minimum(square, nearest_on_arc(chord, arc[ARC["arc_bend"]], curve - start)[1])
        assert np.sqrt(square.max()) <= 0.01 * cell
    finest_first = counts[:-2]
    assert finest_first == sorted(finest_first, reverse=True)
    cubics = [len(course.line.curve) for course in layer.courses]
    assert all(n < 1.5 * len(c) + 20 for n, c in zip(cubics, controls, strict=True))
