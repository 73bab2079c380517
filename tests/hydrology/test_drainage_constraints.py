"""Rivers, lakes and the sea as constraints: paths of nodes are valid, and drained ground obeys them."""

from itertools import count

import numpy as np
import pytest

from sketchterrain.document.store import load_sketch
from sketchterrain.io.resources import preset_names
from sketchterrain.landforms.drainage import DrainageInput, drain
from sketchterrain.landforms.hydrology.courses import course_through
from sketchterrain.landforms.hydrology.drainage_constraints import (
    NodeRaster,
    course_path,
    drainage_constraints,
    lake_outlets,
)
from sketchterrain.landforms.hydrology.rivers import lay_out_water
from sketchterrain.landforms.placement.sea import create_sea
from sketchterrain.stages.runner import Runner
from tests.landforms.sketches import SKETCHES
from tests.terrain.conftest import tiers


def raster_of(sketch, level):
    """Nodes of the sketch's square and a sixth of it around."""
    spacing, margin = sketch.extent / 256 * 2**level, 40 >> level
    side = (256 >> level) + 2 * margin + 1
    return NodeRaster(-margin * spacing, -margin * spacing, spacing, (side, side))


def border(raster, ground):
    base = ground(*raster.positions().T).reshape(raster.shape)
    inside = np.zeros(raster.shape, bool)
    inside[1:-1, 1:-1] = True
    return np.where(inside, np.nan, base)


_ids = count(1)


def course(*points, parent=None, joint=-1):
    line = np.column_stack([np.array(points, float), np.full((len(points), 2), [8.0, 1.0])])
    return course_through(line, next(_ids), 1, parent=parent, joint=joint, taper=0.0)


def check_paths(raster, found):
    """Forced receivers are neighbours, and none of them leads round in a circle."""
    columns, flow = raster.shape[1], found.course.ravel()
    own = np.flatnonzero(flow >= 0)
    row, column = np.abs(np.array(np.divmod(own, columns)) - np.divmod(flow[own], columns))
    assert np.all(np.maximum(row, column) == 1)
    at = own
    for _ in range(flow.size):
        at = flow[at[flow[at] >= 0]]
        if not len(at):
            break
        at = np.unique(at)
    assert not len(at)
    assert np.all(np.isnan(found.base.ravel()[own]))


def test_paths_are_neighbours_without_loops_or_corners():
    raster = NodeRaster(0.0, 0.0, 10.0, (40, 40))
    line = course((20, 20), (200, 60), (210, 150), (120, 160), (110, 70), (300, 300), (500, 320)).line
    path, number = course_path(raster, line)
    row, column = np.divmod(path, 40)
    assert np.all(np.maximum(abs(np.diff(row)), abs(np.diff(column))) == 1)
    assert len(set(path)) == len(path)
    assert np.all(np.maximum(abs(row[2:] - row[:-2]), abs(column[2:] - column[:-2])) == 2)
    assert column[-1] == 39
    assert number[0] == 0
    assert np.all(np.diff(number) >= 0)


def test_tributaries_drain_to_their_stem_and_stems_to_the_border():
    raster = NodeRaster(0.0, 0.0, 10.0, (40, 40))
    base = border(raster, lambda x, y: 0 * x)
    stem = course((200, 390), (200, 200), (200, 0))
    joint = len(stem.line) // 2
    side = course((40, 300), (100, 260), stem.line[joint], parent=stem, joint=joint)
    found = drainage_constraints(raster, base, np.ones(raster.shape, bool), [stem, side])
    check_paths(raster, found)
    at = 30 * 40 + 4
    for _ in range(100):
        if found.course.flat[at] < 0:
            break
        at = int(found.course.flat[at])
    assert divmod(at, 40) == (0, 20)


@tiers("name", ["valley_river", "island_coast", "range_across"], [*preset_names(), *SKETCHES])
def test_drained_ground_falls_along_courses_and_lakes_are_level(name):
    sketch = load_sketch(name) if name in preset_names() else SKETCHES[name](0)

    def ground(x, y):
        return 200 + 0.01 * x - 0.005 * y + 30 * np.sin(x / 1100) * np.cos(y / 900)

    layout = lay_out_water(sketch, seed=sketch.seed, ground=ground, run=Runner())
    lakes = [lake for lake in layout.lakes if lake.label]
    sea = create_sea(sketch)
    outlets = lake_outlets(lakes, layout.courses, ground)
    for level in (0, 2, 3):
        raster = raster_of(sketch, level)
        domain = np.ones(raster.shape, bool)
        found = drainage_constraints(
            raster,
            border(raster, ground),
            domain,
            layout.courses,
            lakes=lakes,
            outlets=outlets,
            coast=None if sea is None else sea.coast,
            sea_level=0.0 if sea is None else sea.level,
        )
        check_paths(raster, found)
        if layout.courses:
            assert (found.course >= 0).sum() >= 10 >> level, level
        repose = np.minimum(0.7, found.slope)
        rain = np.full(raster.shape, raster.spacing**2)
        flow = np.full(raster.shape, 0.9)
        source = DrainageInput(flow, repose, rain, found.base, domain, found.course, (0, 0), level)
        (drained,) = drain([source], sketch.extent / 256, [6])
        own = np.flatnonzero(found.course >= 0)
        assert np.array_equal(drained.receiver.flat[own], found.course.flat[own])
        assert np.all(drained.height.flat[found.course.flat[own]] <= drained.height.flat[own])
        for lake in lakes:
            only = drainage_constraints(raster, border(raster, ground), domain, [], lakes=[lake])
            inside = (only.slope == 0) & np.isnan(found.base)
            if inside.sum() > 9:
                heights = drained.height[inside]
                assert np.median(heights) == pytest.approx(heights.min(), abs=0.3)
