"""Lakes, and rivers through them and through mountains."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sketchterrain.document.sketch import Sketch
from sketchterrain.landforms.hydrology.conflicts import label_mountains, mountain_crossings, resolve_conflicts
from sketchterrain.landforms.hydrology.courses import RiverCourse, reversed_course
from sketchterrain.landforms.hydrology.lakes import (
    distance_inside,
    lake_centre,
    lake_pixels,
    lake_reaches,
    natural_shore,
    painted_lakes,
    runs_inside,
    with_deltas,
)
from sketchterrain.landforms.placement.feature_types import Lake, River, ShapeField
from sketchterrain.stages.runner import Runner

SIZE = 64
ROW, COLUMN = np.mgrid[:SIZE, :SIZE]


def disc(x, y, radius, *, margin=50.0):
    spacing = 2.0
    count = int((radius + margin) / spacing) + 1
    step = spacing * np.arange(-count, count + 1)
    inside = (radius - np.hypot(step, step[:, None])).astype(np.float32)
    return Lake(1, 1, ShapeField(x - count * spacing, y - count * spacing, spacing, inside), 5.0, 2.0)


def test_distance_inside_a_disc_is_the_distance_to_its_circle():
    at = np.array([[100.0, 100.0], [110.0, 100.0], [100.0, 65.0], [100.0, 160.0]])
    np.testing.assert_allclose(distance_inside(disc(100, 100, 40).shape, at), [40, 30, 5, -20], atol=0.6)
    np.testing.assert_allclose(lake_centre(disc(130, 70, 20)), [130, 70])


def test_runs_in_lakes_and_their_rims():
    line = np.column_stack([np.arange(0.0, 400.0, 1.0), np.full(400, 100.0)])
    runs = runs_inside([disc(300, 100, 30), disc(100, 100, 40)], line)
    assert [lake for _, _, lake in runs] == [1, 0]
    (first, last, _), (later, end, _) = runs
    assert (first, last) == pytest.approx((60, 140), abs=1.5)
    assert (later, end) == pytest.approx((270, 330), abs=1.5)

    lake = disc(200, 100, 40, margin=50.0)  # its rim: 0.2 of 50 m
    x = np.arange(0.0, 400.0, 1.0)
    ((shore, first, last, _),) = lake_reaches([lake], np.column_stack([x, np.full(400, 100.0)]))
    assert (shore, first, last) == pytest.approx((150, 160, 240), abs=2)
    ((shore, first, last, _),) = lake_reaches([lake], np.column_stack([x, np.full(400, 145.0)]))
    assert last == first - 1
    assert shore < 200 < last
    assert lake_reaches([lake], np.column_stack([x, np.full(400, 155.0)])) == []


def test_natural_shores_keep_their_area_rim_and_middle():
    shape = disc(1000, 1000, 200, margin=100.0).shape
    shore = natural_shore(shape, pixel=2.0, shift=20.0, seed=3)
    assert shore.spacing == 2.0
    inside, before = shore.inside, shape.inside
    np.testing.assert_allclose(inside[[0, -1]], before[[0, -1]], atol=0.002)
    assert abs((inside > 0).sum() / (before > 0).sum() - 1) < 0.1
    changed = (inside > 0) != (before > 0)
    assert changed.any()
    assert np.abs(before[changed]).max() < 25.0
    assert (inside[before > 100] > 50).all()
    river = cKDTree(np.array([[1200.0, 1000.0]]))
    calm = natural_shore(shape, pixel=2.0, shift=20.0, seed=3, rivers=river)
    mouth = np.array([[1199.0, 1000.0], [1201.0, 1000.0]])
    assert (np.sign(distance_inside(calm, mouth)) == [1, -1]).all()


def test_deltas_take_land_from_the_lake_beside_the_mouth():
    lake = disc(500, 500, 200)
    line = np.column_stack([np.arange(100.0, 500.0, 5.0), np.full(80, 500.0)])
    width = np.full(80, 10.0)
    course = RiverCourse(1, 1, None, -1, line, np.array([0, 79]), width, width, 0.0)
    for each, grown in ((course, True), (reversed_course(course), False)):
        (after,) = with_deltas([lake], [each], seed=1, run=Runner())
        lost = (lake.shape.inside > 0) & (after.shape.inside <= 0)
        assert lost.any() == grown
        row, column = np.nonzero(lost)
        at = np.column_stack([column, row]) * 2.0 + [after.shape.west, after.shape.south]
        assert (np.hypot(*(at - [300.0, 500.0]).T) < 81).all()


def test_painted_lakes_are_below_the_low_parts_of_their_shores():
    layer = (np.hypot(COLUMN - 32, ROW - 32) < 12).astype(np.uint8)
    sketch = Sketch(extent=640.0, layers={"lake": layer}, labels={("lake", 1): {"depth": 9.0}})
    (flat,) = painted_lakes(sketch, lambda x, _: 0 * x + 20.0)
    assert flat.level == pytest.approx(19.75)
    assert flat.depth == 9.0
    (slope,) = painted_lakes(sketch, lambda x, _: 0.1 * x)
    assert 0.1 * 200 < slope.level < 0.1 * 250  # the western shore, at 205 m

    layer = np.zeros((SIZE, SIZE), np.uint8)
    assert lake_pixels(layer) is None
    layer[10, 20] = 1
    tree = lake_pixels(layer).tree
    assert tree is not None
    assert tree.query([10, 23])[0] == 3.0


WIDE = 40
X = np.arange(0.0, 400.0, 5.0)


def sketch(*columns):
    """Mountains from top to bottom between columns of 10 m."""
    layer = np.zeros((WIDE, WIDE), np.uint8)
    for first, end in columns:
        layer[:, first:end] = 1
    return Sketch(extent=10.0 * WIDE, layers={"mountain": layer})


def river(x=X):
    line = np.column_stack([x, np.full(len(x), 200.0), 10 - 0.01 * x])
    ones = np.ones(len(x), np.float32)
    return River(1, 1, line[::10], ones[::10], ones[::10], line, ones, ones)


def resolved(plan, ground=60.0):
    return resolve_conflicts(
        plan, label_mountains(plan.layers["mountain"], Runner()), [river()], [np.full(len(X), ground)], []
    )


def test_crossings_are_runs_inside_mountains_numbered_in_reading_order():
    numbers = label_mountains(sketch((5, 10), (20, 30)).layers["mountain"], Runner())
    assert numbers[0, [0, 5, 9, 10, 20, 29, 30]].tolist() == [0, 1, 1, 0, 2, 2, 0]

    plan = sketch((5, 10), (20, 30))
    found = mountain_crossings(plan, label_mountains(plan.layers["mountain"], Runner()), river().centreline)
    assert [(run.first, run.last, run.mountain) for run in found] == [(10, 19, 1), (40, 59, 2)]
    outside = river().centreline + np.array([0.0, 900.0, 0.0])
    assert mountain_crossings(plan, label_mountains(plan.layers["mountain"], Runner()), outside) == []


def test_rivers_cross_begin_or_end_in_mountains():
    assert resolved(sketch()) == ()
    for columns, x, ground, line in (
        ((10, 20), 145.0, 60.0, "river 1 crosses mountain 1: valley cut 52 m"),
        ((0, 10), X[0], 60.0, "river 1 begins in mountain 1: springs there at 10 m"),
        ((30, 40), X[-1], 60.0, "river 1 ends in mountain 1: valley cut 54 m"),
        ((0, 40), X[(len(X) - 1) // 2], 60.0, "river 1 begins in mountain 1: springs there at 10 m"),
        ((10, 20), 145.0, -5.0, "river 1 crosses mountain 1: valley cut 0 m"),  # above the terrain
    ):
        (found,) = resolved(sketch(columns), ground)
        assert (found.x, found.y, found.line) == (x, 200.0, line)
