"""Hit testing of placed features, positions of drag handles, drags as single history steps."""

import dataclasses

import numpy as np
import pytest

from sketchterrain.landforms.placement.feature_types import FEATURE, FILL_BIT, lake_centre
from sketchterrain.schema.layers import id_of_vector
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.selection import FeatureDrag, handles_of, select_at
from sketchterrain.ui.models.workspace import Handle, Selection


def feature(number: int, x: float, y: float, radius: float, strength: float, kind: int = 0) -> np.ndarray:
    row = np.zeros(1, FEATURE)
    row[["id", "x", "y", "radius", "strength", "type"]] = (number, x, y, radius, strength, kind)
    return row


def test_a_click_selects_the_nearest_centre_or_the_highest_feature():
    mountain, hill_on_it = feature(1, 500, 500, 400, 900), feature(2, 750, 500, 60, 90, 1)
    points = np.concatenate([mountain, hill_on_it, feature(3, 2000, 500, 200, 0.8, 3)])
    placed = Placement(1, points, (), ())

    def at(x: float, y: float, reach: float = 10.0) -> int | None:
        found = select_at(placed, x, y, reach=reach)
        return None if found is None else found.id

    assert [at(508, 500), at(745, 500), at(720, 500, 40.0)] == [1, 2, 2]
    assert [at(450, 450), at(2100, 500), at(1500, 500), at(2000, 1500)] == [1, 3, None, None]
    assert select_at(Placement(1, np.zeros(0, FEATURE), (), ()), 0.0, 0.0, reach=1e9) is None


def test_a_click_in_water_selects_the_river_or_lake(placed):
    points = placed.points[:0]
    wet = Placement(1, points, placed.rivers, placed.lakes)
    for river in placed.rivers:
        x, y = river.centreline[len(river.centreline) // 3, :2]
        assert select_at(wet, x, y, reach=0.0) == Selection("course", river.id)
    assert select_at(wet, -1e6, -1e6, reach=1.0) is None
    found = [
        select_at(Placement(1, points, (), (lake,)), *lake_centre(lake), reach=0.0) for lake in placed.lakes
    ]
    assert any(found)
    assert all(
        each in (None, Selection("water", lake.id)) for each, lake in zip(found, placed.lakes, strict=True)
    )


def test_water_that_a_vector_made_selects_the_vector(placed):
    river = dataclasses.replace(placed.rivers[0], id=id_of_vector("river", 7))
    x, y = river.centreline[9, :2]
    found = select_at(Placement(1, placed.points[:0], (river,), ()), x, y, reach=0.0)
    assert found == Selection("river", 7)


def test_handles_are_at_centre_radius_points_and_width(placed):
    for point in placed.points[:: max(len(placed.points) // 20, 1)]:
        move, radius = handles_of(placed, Selection("feature", int(point["id"])))
        assert (move.role, move.x, move.y) == ("move", point["x"], point["y"])
        distance = np.hypot(radius.x - radius.base_x, radius.y - radius.base_y)
        assert distance == pytest.approx(float(point["radius"]))
    for river in placed.rivers:
        *points, width = handles_of(placed, Selection("course", river.id))
        assert [each.selection.index for each in points] == list(range(len(points)))
        at = np.argmin(np.hypot(*(river.centreline[:, :2] - [width.base_x, width.base_y]).T))
        half = 0.5 * float(river.centreline_width[at])
        if river.mean_width is not None:  # the width that is set, without its variation along the river
            middle = len(river.points) // 2
            half = 0.5 * float(river.mean_width[middle - 1 : middle + 1].mean())
        assert np.hypot(width.x - width.base_x, width.y - width.base_y) == pytest.approx(half)


@pytest.fixture
def handle(placed) -> Handle:
    painted = placed.points[placed.points["id"] < FILL_BIT]
    return handles_of(placed, Selection("feature", int(painted["id"][0])))[0]


def test_a_drag_is_one_step_and_keeps_its_offset_from_the_mouse(document, placed, handle):
    before = document.sketch
    drag = FeatureDrag(document, placed, handle, grab=(handle.x - 4.0, handle.y + 3.0))
    for step in range(1, 9):
        drag.to(handle.x - 4.0 + 50 * step, handle.y + 3.0)
    drag.finish()
    assert document.history.titles == ("Open", "Move mountain")
    edit = document.sketch.edits[-1]
    assert (edit.x, edit.y) == (round(handle.x + 400.0, 3), round(handle.y, 3))
    assert (drag.x, drag.y) == (handle.x + 400.0, handle.y)
    document.undo()
    assert document.sketch.edits == before.edits
    for away in (10.0, 20.0):
        drag = FeatureDrag(document, placed, handle)
        drag.to(handle.x + away, handle.y)
        drag.finish()
    assert len(document.history.titles) == 3  # without the undone one


def test_a_cancelled_drag_restores_and_one_overtaken_by_the_document_ends(document, placed, handle):
    before = document.sketch
    FeatureDrag(document, placed, handle).cancel()
    drag = FeatureDrag(document, placed, handle)
    drag.to(0.0, 0.0)
    drag.to(10.0, 0.0)
    drag.cancel()
    drag.to(50.0, 50.0)  # has ended
    assert document.sketch is before
    assert document.history.titles == ("Open",)

    drag = FeatureDrag(document, placed, handle)
    drag.to(100.0, 100.0)
    document.undo()
    now = document.sketch
    drag.to(200.0, 200.0)
    drag.cancel()
    assert document.sketch is now

    drag = FeatureDrag(document, placed, handle)
    drag.to(float("nan"), 0.0)
    assert "expected a number" in drag.problem
    assert document.sketch is now
    drag.to(5.0, 5.0)
    assert drag.problem == ""
