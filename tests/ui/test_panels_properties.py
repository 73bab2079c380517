"""Properties of labels, features, rivers and lakes."""

from __future__ import annotations

import dataclasses

import pytest
from PyQt6.QtCore import Qt
from PyQt6.QtTest import QTest

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.commands.placed_edits import is_locked, parent_of, width_of
from sketchterrain.ui.models.workspace import Chosen
from sketchterrain.ui.panels.form import NumberRow
from sketchterrain.ui.panels.properties import PropertiesPanel


@pytest.fixture
def panel(qtbot, document, workspace, link, placed):
    link.placed = placed
    panel = PropertiesPanel(document, workspace, link)
    qtbot.addWidget(panel)
    panel.resize(300, 700)
    panel.show()
    return panel


@pytest.fixture
def mountain(panel, workspace, placed):
    """A mountain that is selected: its row of FEATURE, and what is chosen."""
    point = placed.points[placed.points["type"] == 0][0]
    workspace.chosen = Chosen("feature", int(point["id"]))
    return point


@pytest.fixture
def river(panel, workspace, placed):
    each = max(placed.rivers, key=lambda river: len(river.points))
    workspace.chosen = Chosen("river", each.id)
    return each


def test_a_form_has_a_row_for_every_declared_property(panel, document, workspace) -> None:
    for layer in LAYERS:
        workspace.use_label(layer, 1)
        form = panel.label_page.forms[layer]
        assert form.isVisible(), layer
        assert list(form.rows) == list(LAYERS[layer].parameters), layer
        assert not any(
            other.isVisible() for name, other in panel.label_page.forms.items() if name != layer
        ), layer
        for name, value in document.sketch.properties(layer, 1).items():
            row = form.rows[name]
            assert row.reset.isVisible() == (value != LAYERS[layer].parameters[name].default), layer


def test_an_edit_is_a_step_and_reset_takes_it_out_of_the_file(panel, document, workspace) -> None:
    workspace.use_label("mountain", 2)
    row = panel.label_page.forms["mountain"].rows["height"]
    row.box.setValue(777.0)
    assert document.sketch.properties("mountain", 2)["height"] == 777.0
    assert document.history.titles[-1] == "Set height of mountains 2"
    document.undo()
    assert row.box.value() == document.sketch.properties("mountain", 2)["height"]
    assert document.history.position == 0

    workspace.use_label("mountain", 1)
    assert row.reset.isVisible()
    row.reset.click()
    assert "height" not in document.sketch.labels["mountain", 1]
    assert row.box.value() == 600.0
    assert not row.reset.isVisible()


def test_a_dragged_slider_is_one_live_step_even_over_its_first_value(panel, document, workspace) -> None:
    workspace.use_label("mountain", 1)
    row = panel.label_page.forms["mountain"].rows["height"]
    live = []
    document.live_changed.connect(lambda: live.append(document.sketch.properties("mountain", 1)["height"]))
    row.slider.setSliderDown(True)
    for value in range(400, 500, 10):
        row.slider.setValue(value)
    row.slider.setSliderDown(False)
    assert document.history.position == 1
    assert len(set(live)) == 10
    assert row.box.value() == document.sketch.properties("mountain", 1)["height"]
    assert row.slider.value() == 490

    # The sketch is the same one again in the middle of the drag; the slider goes on.
    row = panel.label_page.forms["mountain"].rows["peakiness"]
    row.slider.setSliderDown(True)
    for value in (550, 600, 650):
        row.slider.setValue(value)
        assert row.slider.value() == value
        assert document.sketch.properties("mountain", 1)["peakiness"] == round(value / 1000, 2)
    row.slider.setSliderDown(False)


def test_a_river_flows_downhill_or_where_one_says(panel, document, workspace):
    workspace.use_label("river", 1)
    row = panel.label_page.forms["river"].rows["flow"]
    was_downhill = row.check.isChecked()
    row.check.click()
    assert (document.sketch.properties("river", 1)["flow"] == -1.0) != was_downhill
    assert row.slider.isEnabled() == was_downhill


def test_what_is_being_typed_belongs_to_the_label_that_was_shown(panel, document, workspace):
    for other in (("mountain", 2), ("material", 1), ("hill", 1)):
        workspace.use_label("mountain", 1)
        box = panel.label_page.forms["mountain"].rows["height"].box
        before = document.sketch.properties(*other)
        box.setFocus()
        box.selectAll()
        QTest.keyClicks(box, "901")
        workspace.use_label(*other)  # by the pick tool: the keyboard stays here
        assert document.sketch.properties("mountain", 1)["height"] == 901.0
        assert document.sketch.properties(*other) == before
        document.undo()
        assert document.history.position == 0


def test_what_is_being_typed_belongs_to_the_feature_that_was_shown(
    panel, document, workspace, placed, mountain
):
    row = panel.chosen_page.forms["feature"].rows["radius"]
    row.box.setFocus()
    row.box.selectAll()
    QTest.keyClicks(row.box, "123")
    other = int(placed.points["id"][placed.points["type"] == 0][1])
    workspace.chosen = Chosen("feature", other)
    assert [(edit.feature, edit.radius) for edit in document.sketch.edits] == [(int(mountain["id"]), 123.0)]
    point = placed.points[placed.points["id"] == other][0]
    assert row.number == float(point["radius"])


def test_a_selected_feature_replaces_the_label_and_shows_its_numbers(panel, mountain, workspace) -> None:
    rows = panel.chosen_page.forms["feature"].rows
    for name in ("x", "y", "radius"):
        assert rows[name].number == float(mountain[name])
    assert rows["height"].number == pytest.approx(float(mountain["strength"]))
    assert rows["height"].isVisible()
    assert not rows["density"].isVisible()

    assert all(isinstance(row, NumberRow) for row in panel.chosen_page.forms["feature"].rows.values())

    assert panel.chosen_page.isVisible()
    assert not panel.label_page.isVisible()
    panel.back.click()
    assert workspace.chosen is None
    assert panel.label_page.isVisible()
    assert not panel.chosen_page.isVisible()


@pytest.mark.parametrize(("name", "action"), [("x", "move"), ("radius", "resize"), ("height", "strength")])
def test_a_number_of_a_feature_becomes_an_edit(panel, document, mountain, name, action):
    row = panel.chosen_page.forms["feature"].rows[name]
    row.box.setValue(row.box.value() + 25.0)
    wanted = row.box.value()
    assert [edit.action for edit in document.sketch.edits] == [action]
    assert wanted in document.sketch.edits[0].values.values()
    assert row.number == wanted, "shown at once, before it is placed anew"
    row.box.setValue(wanted + 10.0)
    assert len(document.sketch.edits) == 1


def test_moving_east_keeps_north_exactly(panel, document, mountain):
    row = panel.chosen_page.forms["feature"].rows["x"]
    row.box.setValue(row.box.value() + 25.0)
    assert document.sketch.edits[0].y == pytest.approx(float(mountain["y"]), abs=0.001)


def test_a_forest_has_a_density(panel, document, workspace, placed):
    point = placed.points[placed.points["type"] == 3][0]
    workspace.chosen = Chosen("feature", int(point["id"]))
    rows = panel.chosen_page.forms["feature"].rows
    assert rows["density"].isVisible()
    assert not rows["height"].isVisible()
    rows["density"].slider.setValue(330)
    assert document.sketch.edits[0].strength == 0.33


def test_lock_reset_and_delete_are_steps_that_undo_shows(panel, document, mountain, workspace) -> None:
    panel.chosen_page.lock.click()
    document.undo()
    assert not panel.chosen_page.lock.isChecked()
    assert document.history.position == 0

    page = panel.chosen_page
    chosen = workspace.chosen
    assert not page.reset.isEnabled()
    page.lock.click()
    assert is_locked(document.sketch, chosen)
    assert page.lock.isChecked()
    page.lock.click()
    assert not is_locked(document.sketch, chosen)
    page.forms["feature"].rows["height"].box.setValue(50.0)
    assert page.reset.isEnabled()
    page.reset.click()
    assert document.sketch.edits == ()
    page.delete.click()
    assert [edit.action for edit in document.sketch.edits] == ["delete"]
    assert workspace.chosen is None
    titles = [
        "Lock mountain",
        "Unlock mountain",
        "Set height of mountain",
        "Reset mountain",
        "Delete mountain",
    ]
    assert list(document.history.titles[1:]) == titles


def test_what_is_gone_is_said(panel, workspace, link, placed, mountain):
    link.placed = dataclasses.replace(placed, points=placed.points[:0])
    link.placed_changed.emit(link.placed)
    assert not panel.chosen_page.delete.isEnabled()
    assert not any(form.isVisible() for form in panel.chosen_page.forms.values())
    link.placed = placed
    link.placed_changed.emit(placed)
    assert panel.chosen_page.delete.isEnabled()
    assert panel.chosen_page.lock.isEnabled()


def test_a_rivers_width_is_set(panel, document, workspace, link, placed, river):
    form = panel.chosen_page.forms["river"]
    assert form.width_row.number == pytest.approx(width_of(document.sketch, placed, workspace.chosen))
    form.width_row.box.setValue(40.0)
    assert [(edit.action, edit.width) for edit in document.sketch.edits] == [("width", 40.0)]
    assert form.width_row.number == 40.0


def test_control_points_of_a_river_are_chosen_moved_and_checked(
    panel, document, workspace, placed, river
) -> None:
    form = panel.chosen_page.forms["river"]
    assert not form.east.isEnabled()
    form.points.setFocus()
    QTest.keyClick(form.points, Qt.Key.Key_Up)
    assert workspace.chosen.index == 0
    form.points.setValue(2)
    assert workspace.chosen == Chosen("river", river.id, 1)
    assert form.east.isEnabled()
    assert form.east.number == river.points[1, 0]
    form.east.box.setValue(form.east.box.value() + 30.0)
    (edit,) = document.sketch.edits
    assert edit.action == "move_point"
    assert edit.x == pytest.approx(form.east.box.value())
    assert edit.y == pytest.approx(river.points[1, 1], abs=0.001)
    form.points.setValue(0)
    assert workspace.chosen == Chosen("river", river.id, None)
    document.undo()
    workspace.chosen = Chosen("river", river.id, len(river.points))
    assert form.isVisible()
    assert form.points.value() == 0
    assert not form.east.isEnabled()
    panel.chosen_page.delete.click()
    assert [edit.action for edit in document.sketch.edits] == ["delete"]


def test_confluences_stay_and_lakes_can_be_deleted(panel, workspace, placed) -> None:
    lake = placed.lakes[0]
    workspace.chosen = Chosen("lake", lake.id)
    assert panel.chosen_page.forms["lake"].isVisible()
    assert not panel.chosen_page.lock.isVisible()
    assert panel.chosen_page.delete.isEnabled()

    joining = [each for each in placed.rivers if parent_of(placed, each) is not None]
    if not joining:
        pytest.skip("no river joins another one")
    workspace.chosen = Chosen("river", joining[0].id, len(joining[0].points) - 1)
    assert not panel.chosen_page.forms["river"].east.isEnabled()
