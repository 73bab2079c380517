"""Rivers and lakes from vectors: how closely courses follow lines, networks, areas, lakes."""

import numpy as np
import pytest
import shapely

import sketchterrain as st
from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable
from sketchterrain.generation.building import make_recipe
from sketchterrain.landforms.hydrology.lakes import area_field
from sketchterrain.landforms.hydrology.rivers import lay_out_water
from sketchterrain.landforms.hydrology.vector_rivers import line_path, line_tolerance, rounded_corners
from sketchterrain.measure.adherence import measure_adherence
from sketchterrain.measure.adherence_rivers import standing_water
from sketchterrain.schema.layers import vector_of
from sketchterrain.stages.runner import Runner

from .conftest import tiers


def line(*points, **properties):
    return Feature(LINE, (np.array(points, dtype=np.float64),), properties=properties)


def area(*rings, **properties):
    return Feature(AREA, tuple(np.array(ring, dtype=np.float64) for ring in rings), properties=properties)


DRY = {"aridity": 1.0}  # hardly any streams


def sketch(*rivers, lakes=(), climate=DRY, **settings):
    vectors = {
        "river": FeatureTable("river").edited(add=rivers),
        "lake": FeatureTable("lake").edited(add=lakes),
    }
    return Sketch(vectors=vectors, climate=climate, **settings)


def slope(x, y):
    """Ground that falls to the east."""
    return 200.0 - 0.02 * x + 0.0 * y


def courses(of, ground=slope, run=None):
    return lay_out_water(of, seed=0, ground=ground, run=run or Runner()).courses


def zigzag(count, seed=0):
    steps = np.random.default_rng(seed).normal(0.0, 1.0, (count, 2)) * [20.0, 60.0] + [50.0, -10.0]
    return np.array([300.0, 3000.0]) + np.cumsum(steps, axis=0)


def distance_between(one, other):
    """Return the greatest distance of either line from the other."""
    a, b = (shapely.segmentize(shapely.linestrings(each), 1.0) for each in (one, other))
    to = shapely.distance(shapely.points(shapely.get_coordinates(a)), b)
    return max(to.max(), shapely.distance(shapely.points(shapely.get_coordinates(b)), a).max())


@pytest.mark.parametrize(("fidelity", "smooth"), [(0.0, 1), (0.8, 0), (1.0, 0), (1.0, 1)])
def test_courses_follow_their_lines(fidelity, smooth):
    of = sketch(line(*zigzag(20), smooth=smooth, directed=1), fidelity=fidelity)
    (course,) = courses(of)
    farthest = distance_between(line_path(of.vectors["river"], 0), course.line)
    assert farthest <= line_tolerance(of) + 0.01
    assert fidelity < 1.0 or farthest <= 0.5


@pytest.mark.parametrize("angle", [1.0, 30.0, 90.0, 170.0, 180.0])
@pytest.mark.parametrize("shorter", [0.5, 5.0, 500.0])
def test_round_corners_stay_within_their_tolerance(angle, shorter):
    turn = np.radians(angle)
    path = np.array([[-500.0, 0.0], [0.0, 0.0], [shorter * np.cos(turn), shorter * np.sin(turn)]])
    points, vertices = rounded_corners(path, 0.25, 12.0)
    np.testing.assert_array_equal(points[vertices[[0, 2]]], path[[0, 2]])
    assert distance_between(path, points) <= 0.2501
    assert np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).max() <= 12.0 + 1e-9


def test_built_rivers_are_within_half_a_metre_at_fidelity_1(context):
    of = sketch(
        line(*zigzag(20), directed=1, width=14.0),
        line([300.0, 600.0], [900.0, 1500.0], zigzag(20)[10], smooth=1, directed=1),
        fidelity=1.0,
    )
    measured = measure_adherence(st.build(of, device=context)).rivers
    assert [each.id for each in measured] == [1, 2]
    for each in measured:
        assert not each.lost
        assert each.greatest_distance * of.pixel_size <= 0.5
        assert each.descending == 1.0


def test_a_line_without_a_river_is_lost(context):
    drowned = sketch(line([300.0, 600.0], [900.0, 1500.0]), coast={"sea_level": 5000.0})
    (measured,) = measure_adherence(st.build(drowned, device=context)).rivers
    assert measured.lost


def test_widths_and_depths_are_those_of_the_lines():
    stem, branch = (
        line([0, 2000], [2000, 2000], [4000, 2000], width=30.0, depth=4.0, directed=1),
        line([500, 3500], [2000, 2000], width=5.0, directed=1),
    )
    labels = {("river", 1): {"depth": 1.5}}
    rivers = make_recipe(sketch(stem, branch, labels=labels)).rivers
    by_line = {vector_of(each.id): each for each in rivers if each.label}
    np.testing.assert_allclose(by_line[1].centreline_width, 30.0)
    np.testing.assert_allclose(by_line[2].centreline_width, 5.0)
    assert by_line[1].depth[0] == 4.0
    assert by_line[2].depth[0] == 1.5


def test_lines_with_a_direction_keep_it_and_others_flow_down():
    west, east = [300.0, 2000.0], [3800.0, 2000.0]
    for points, directed, spring in (
        ((west, east), 0, west),
        ((east, west), 0, west),
        ((east, west), 1, east),
    ):
        (course,) = courses(sketch(line(*points, directed=directed)))
        assert course.line[0].tolist() == spring


def test_lines_that_share_a_vertex_are_one_network():
    found = courses(sketch(line([500, 500], [2000, 2000], [3500, 2000]), line([500, 3500], [2000, 2000])))
    (stem,) = [each for each in found if each.parent is None]
    (branch,) = [each for each in found if each.parent is not None]
    assert branch.parent is stem
    np.testing.assert_array_equal(branch.line[-1], stem.line[branch.joint])


def test_a_line_that_ends_in_the_bed_of_another_one_joins_it():
    stem = line([300, 2000], [3800, 2000], width=40.0, directed=1)
    beside, apart = (line([1000, 3500], [2000, 2000 + away], directed=1) for away in (15.0, 60.0))
    between = line([1000, 3500], [2000, 2000], directed=1)  # two vertices
    for branch, joins in ((beside, True), (apart, False), (between, True)):
        assert [each.parent is None for each in courses(sketch(stem, branch))] == [True, not joins]


def test_arms_of_a_loop_begin_and_end_at_the_stem():
    found = courses(
        sketch(
            line([300, 2000], [1000, 2000], directed=1),
            line([1000, 2000], [1500, 2500], [2000, 2000], directed=1),
            line([1000, 2000], [1500, 1200], [2000, 2000], directed=1),
            line([2000, 2000], [3500, 2000], directed=1),
        )
    )
    arm = next(each for each in found if each.parent is not None)
    assert len(found) == 2
    assert arm.line[0].tolist() == [1000.0, 2000.0]
    np.testing.assert_array_equal(arm.line[-1], arm.parent.line[arm.joint])


def test_a_river_may_part_into_two_mouths():
    found = courses(
        sketch(
            line([300, 2000], [2000, 2000], directed=1),
            line([2000, 2000], [3500, 3000], directed=1),
            line([2000, 2000], [3500, 1200], directed=1),
        )
    )
    assert {tuple(each.line[-1]) for each in found} == {(3500.0, 3000.0), (3500.0, 1200.0)}
    assert all(each.parent is None for each in found)


def test_rivers_that_leave_the_sketch_go_on_and_others_end():
    inner, outer = line([500, 500], [3000, 500], directed=1), line([500, 3000], [4095, 3000], directed=1)
    ends = {vector_of(each.id): each.line[-1] for each in courses(sketch(inner, outer))}
    assert ends[1].tolist() == [3000.0, 500.0]
    assert ends[2][0] > 5000.0


def test_a_painted_river_that_ends_at_a_line_is_its_tributary():
    image = np.zeros((512, 512), np.uint8)
    image[100:255, 200] = 1
    found = courses(sketch(line([300, 2048], [3800, 2048], directed=1), layers={"river": image}))
    drawn = next(each for each in found if vector_of(each.id))
    painted = next(each for each in found if not vector_of(each.id))
    assert painted.parent is drawn
    np.testing.assert_array_equal(painted.line[-1], drawn.line[painted.joint])


def wide_river():
    """Return an area of varying width, and an axis that is not in its middle."""
    x = np.linspace(200.0, 3800.0, 120)
    axis = np.stack([x, 2000.0 + 500.0 * np.sin(x / 700.0)], axis=-1)
    half, off = 50.0 + 30.0 * np.sin(x / 300.0), 15.0
    ring = np.concatenate([axis + np.outer(half + off, [0, 1]), (axis - np.outer(half - off, [0, 1]))[::-1]])
    return area(ring), line(*axis[::3], directed=1)


@pytest.mark.parametrize(("has_axis", "least"), [(True, 0.9), (False, 0.85)])
def test_wide_rivers_fill_their_areas(context, has_axis, least):
    bounds, axis = wide_river()
    terrain = st.build(sketch(bounds, *([axis] if has_axis else [])), device=context)
    at = 20.48 * (np.arange(200) + 0.5)
    x, y = np.meshgrid(at, at)
    wet = standing_water(terrain.recipe, "river", x, y, terrain.heights(x, y))
    inside = shapely.contains_xy(shapely.Polygon(bounds.rings[0]), x, y)
    assert (wet & inside).sum() > least * (wet | inside).sum()


def test_lakes_have_the_outline_and_depth_of_their_areas(context):
    ring, island = (
        [[1000, 1000], [2000, 900], [2200, 1800], [1100, 1700]],
        [[1500, 1200], [1700, 1200], [1600, 1400]],
    )
    terrain = st.build(sketch(lakes=[area(ring, island, depth=9.0)]), device=context)
    (lake,) = (each for each in terrain.recipe.lakes if vector_of(each.id) == 1)
    assert lake.depth == 9.0
    (measured,) = (each for each in measure_adherence(terrain).shapes if each.layer == "lake")
    assert measured.iou > 0.9
    assert terrain.heights(np.array([1600.0]), np.array([1250.0]))[0] > lake.level


def test_fields_of_areas_are_exact_distances():
    ring = shapely.Polygon([(0, 0), (100, 0), (100, 50), (0, 50)])
    field = area_field(ring, spacing=8.0, margin=60.0)
    rows, columns = field.inside.shape
    y, x = np.mgrid[:rows, :columns] * field.spacing
    points = shapely.points(x + field.west, y + field.south)
    expected = np.where(shapely.contains(ring, points), 1, -1) * shapely.distance(points, ring.boundary)
    np.testing.assert_allclose(field.inside, expected, atol=1e-4)


def test_unchanged_courses_are_the_same_objects():
    run, of = Runner(), sketch(line(*zigzag(20), directed=1), line([300, 300], [3000, 600]))
    hill = np.zeros((512, 512), np.uint8)
    hill[50:80, 50:80] = 1
    before, after = (courses(each, run=run) for each in (of, of.replace(layers={**of.layers, "hill": hill})))
    assert all(a is b for a, b in zip(before, after, strict=True))


def random_vectors(rng):
    """Return rivers and lakes of any form: short and long, crossing, closed, beyond the sketch."""
    rivers, lakes, nodes = [], [], []
    for _ in range(rng.integers(1, 7)):
        path = np.cumsum(rng.normal(0, rng.choice([1, 30, 300]), (rng.integers(2, 12), 2)), axis=0)
        path = np.rint((path + rng.uniform(-500, 4500, 2)) * 1024) / 1024
        if nodes and rng.random() < 0.6:
            path[rng.choice([0, -1])] = nodes[rng.integers(len(nodes))]
        path = np.concatenate([path, path[:1]]) if rng.random() < 0.15 else path
        nodes += list(path)
        numbers = {"width": float(rng.choice([0, 1, 12, 100, 600])), "flow": float(rng.uniform(0, 360))}
        properties = {name: value for name, value in numbers.items() if rng.random() < 0.4}
        flags = {name: 1 for name in ("smooth", "directed") if rng.random() < 0.5}
        rivers.append(line(*path, **properties, **flags))
    for kept in (rivers, lakes):
        angle = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 9)))
        ring = rng.uniform(0, 4096, 2) + rng.uniform(5, 400) * np.stack(
            [np.cos(angle), np.sin(angle)], axis=-1
        )
        kept.append(area(ring))
    return rivers, lakes


@tiers("seed", [9], range(12))
def test_rivers_of_random_vectors_never_rise(seed):
    rng = np.random.default_rng([7, seed])
    rivers, lakes = random_vectors(rng)
    of = sketch(
        *rivers, lakes=lakes, fidelity=float(rng.choice([0.0, 0.8, 1.0])), density={"hill": 1.0}, climate={}
    )
    recipe = make_recipe(of)
    assert len({each.id for each in recipe.rivers}) == len(recipe.rivers)
    for each in recipe.rivers:
        assert np.isfinite(each.centreline).all()
        assert (np.diff(each.centreline[:, 2]) <= 1e-9).all()
        assert (each.centreline_width > 0.0).all()
