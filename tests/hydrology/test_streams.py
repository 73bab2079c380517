"""Streams: channels of drained ground become courses that fall, join water, and meander where it is level."""

import numpy as np
import pytest

from sketchterrain.document.edits import Edit
from sketchterrain.generation.building import make_recipe
from sketchterrain.geometry.splines import arc_length
from sketchterrain.landforms.drainage import DrainageInput, drain
from sketchterrain.landforms.hydrology.courses import course_through
from sketchterrain.landforms.hydrology.drainage_constraints import NodeRaster
from sketchterrain.landforms.hydrology.streams import Flow, is_stream, stream_courses
from sketchterrain.landforms.placement.feature_types import move_edit
from sketchterrain.stages.runner import Runner
from tests import terrains

SPACING, SIDE = 20.0, 121


def drained_valley(fall, *, cross=0.3):
    """A square that drains to the middle of its southern border, along a valley of a slope."""
    shape = (SIDE, SIDE)
    column = np.arange(SIDE)
    base = np.full(shape, np.nan)
    base[0, SIDE // 2] = 0.0
    repose = np.full(shape, cross)
    repose[:, SIDE // 2] = fall
    receiver = np.full(shape, -1, np.int32)
    for row in range(1, SIDE):
        receiver[row, SIDE // 2] = (row - 1) * SIDE + SIDE // 2
    towards = np.sign(SIDE // 2 - column)
    beside = np.flatnonzero(towards)
    course = receiver.copy()
    for row in range(SIDE):
        course[row, beside] = row * SIDE + beside + towards[beside]
    source = DrainageInput(
        np.full(shape, 10.0), repose, np.full(shape, SPACING**2), base, np.ones(shape, bool), course
    )
    found = drain([source], SPACING, [2])[0]
    return Flow(
        NodeRaster(0.0, 0.0, SPACING, shape),
        found.height,
        found.area,
        found.receiver,
        *np.zeros((3, *shape), bool),
    )


def streams_of(flow, courses=(), runoff=1.0, seed=1):
    size = ((SIDE - 1) * SPACING,) * 2
    return stream_courses(
        flow, courses, size=size, runoff=runoff, seed=seed, displaced=lambda at: at, run=Runner()
    )


def sinuosity(course):
    """Length over distance, over stretches of 12 widths."""
    arc = arc_length(course.line)
    found = []
    for start in np.arange(0.0, arc[-1], SPACING):
        end = start + 12.0 * float(np.interp(start, arc, course.width))
        if end > arc[-1]:
            break
        points = [[np.interp(s, arc, course.line[:, i]) for i in (0, 1)] for s in (start, end)]
        found.append((end - start) / np.hypot(*np.subtract(*points)))
    return float(np.median(found))


def test_a_valley_has_one_stream_that_widens_as_the_root_of_its_area():
    flow = drained_valley(0.1)
    (stream,) = streams_of(flow)
    assert is_stream(stream.id)
    assert stream.parent is None
    # It begins where half a square kilometre drains to it.
    row = round(stream.line[0, 1] / SPACING)
    assert flow.area[row, SIDE // 2] > 0.5e6 >= flow.area[row + 1, SIDE // 2]
    away = np.abs(stream.line[:, 0] - SIDE // 2 * SPACING)
    assert away.max() < 1.0  # it is too steep for meanders
    middle = len(stream.line) // 3
    area = np.interp(stream.line[middle, 1] / SPACING, np.arange(SIDE), flow.area[:, SIDE // 2])
    assert stream.width[middle] == pytest.approx(2.2e-3 * np.sqrt(area), rel=0.03)
    assert np.all(stream.depth <= 0.6 * stream.width + 1e-9)


@pytest.mark.parametrize(("fall", "least", "most"), [(0.002, 1.1, 1.6), (0.015, 1.1, 1.6), (0.06, 1.0, 1.01)])
def test_streams_meander_on_level_floors_only(fall, least, most):
    found = [sinuosity(streams_of(drained_valley(fall), seed=seed)[0]) for seed in range(6)]
    assert least <= np.median(found) <= most


def test_a_stream_joins_the_painted_river_that_it_comes_to():
    flow = drained_valley(0.05)
    points = [(200.0, 700.0, 12.0, 2.0), (1100.0, 650.0, 12.0, 2.0), (2300.0, 500.0, 12.0, 2.0)]
    river = course_through(np.array(points), 1, 1, parent=None, joint=-1, taper=0.0)
    (stream,) = streams_of(flow, [river])
    assert stream.parent is river
    np.testing.assert_array_equal(stream.line[-1], river.line[stream.joint])
    assert stream.line[:, 1].min() > 450.0


def test_no_stream_runs_where_it_is_barred():
    flow = drained_valley(0.05)
    flow.barred[40:60] = True
    streams = streams_of(flow)
    assert len(streams) == 2
    for stream in streams:
        row = stream.line[:, 1] / SPACING
        assert not ((row > 39.5) & (row < 59.5)).any()


@pytest.fixture(scope="module")
def recipe():
    return terrains.preset("valley_river").recipe


def test_streams_of_a_preset_fall_and_join_water(recipe):
    streams = [river for river in recipe.rivers if river.label == 0]
    assert len(streams) > 5
    assert all(is_stream(river.id) for river in streams)
    ends = np.concatenate([river.centreline[:, :2] for river in recipe.rivers])
    joined = 0
    for river in streams:
        assert np.all(np.diff(river.centreline[:, 2]) <= 0.0)
        at = np.isclose(ends, river.centreline[-1, :2]).all(axis=1).sum()
        joined += at > 1
    assert joined
    painted = len(recipe.rivers) - len(streams)
    numbers = [int(each.line.split()[1]) for each in recipe.resolutions if each.line.startswith("river ")]
    assert all(number <= painted for number in numbers)


def test_streams_can_be_edited(recipe):
    sketch = terrains.preset("valley_river").sketch
    streams = [river for river in recipe.rivers if river.label == 0]
    moved, deleted = streams[0], streams[1]
    x, y = (float(v) for v in moved.points[3, :2])
    unknown = Edit("delete", deleted.id ^ 5)
    edits = (move_edit(moved, 3, x=x + 15.0, y=y), Edit("delete", deleted.id), unknown)
    after = make_recipe(sketch.replace(edits=edits))
    assert len(after.orphans) == 1
    left = {river.id: river for river in after.rivers}
    assert deleted.id not in left
    assert np.hypot(left[moved.id].points[:, 0] - x - 15.0, left[moved.id].points[:, 1] - y).min() < 0.1
