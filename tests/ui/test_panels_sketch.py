"""Panels of layers, properties, world and view settings."""

import dataclasses

import numpy as np
import pytest
from PyQt6.QtCore import QPoint, Qt
from PyQt6.QtTest import QTest

from sketchterrain.document.label_layers import labels_in
from sketchterrain.document.sketch import TABLES
from sketchterrain.document.store import load_sketch
from sketchterrain.render.overlays import OVERLAYS
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS
from sketchterrain.schema.parameters import SKETCH
from sketchterrain.ui.commands import find_parent_river, is_locked, labels_of, set_property, width_of
from sketchterrain.ui.engine.protocol import ViewState
from sketchterrain.ui.models.elevation import SketchElevation
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.panels.base import BasePanel
from sketchterrain.ui.panels.layer_list import EYE, LOCK, NAME
from sketchterrain.ui.panels.layers import LayersPanel
from sketchterrain.ui.panels.properties import PropertiesPanel
from sketchterrain.ui.panels.settings import OVERLAY_TITLES, ViewPanel, WorldPanel

from .events import overrides


@pytest.fixture
def layers(show_widget, document, workspace):
    return show_widget(LayersPanel(document, workspace))


@pytest.fixture
def world(show_widget, document):
    return show_widget(WorldPanel(document))


@pytest.fixture
def view(show_widget, document, link):
    return show_widget(ViewPanel(document, link))


@pytest.fixture
def properties(show_widget, document, workspace, link, placed):
    link.placed = placed
    return show_widget(PropertiesPanel(document, workspace, link))


@pytest.fixture
def mountain(properties, workspace, placed):
    point = placed.points[placed.points["type"] == 0][0]
    workspace.selection = Selection("feature", int(point["id"]))
    return point


def typed(field, text):
    field.setFocus()
    field.selectAll()
    QTest.keyClicks(field, text)


def places(panel):
    return [(row.layer, row.label) for row in panel.list.rows]


def click(panel, place, column):
    item = panel.list.topLevelItem(places(panel).index(place))
    x = panel.list.columnViewportPosition(column) + panel.list.columnWidth(column) // 2
    at = QPoint(x, panel.list.visualItemRect(item).center().y())
    QTest.mouseClick(panel.list.viewport(), Qt.MouseButton.LeftButton, pos=at)


def test_rows_list_the_declared_layers_and_used_labels(layers, document):
    assert list(dict.fromkeys(layer for layer, _ in places(layers))) == list(LAYERS)
    seen = set()
    for row in layers.list.rows:
        assert (row.visible is not None) == (row.layer not in seen)
        seen.add(row.layer)
    for name in LAYERS:
        declared = {label for layer, label in document.sketch.labels if layer == name}
        used = set(labels_of(document.sketch, name)) | declared
        assert {label for layer, label in places(layers) if layer == name} == (used or {1})
    document.do("Set height", set_property(document.sketch, "mountain", 1, "height", 1234.0))
    row = next(row for row in layers.list.rows if (row.layer, row.label) == ("mountain", 1))
    assert row.detail.startswith("1234 m · ")
    assert "km²" in row.detail


def test_clicks_activate_labels_and_toggle_eyes_and_locks(layers, workspace):
    click(layers, ("hill", 1), NAME)
    assert (workspace.layer, workspace.label) == ("hill", 1)
    click(layers, ("hill", 1), EYE)
    click(layers, ("river", 1), LOCK)
    assert not workspace.look("hill").visible
    assert workspace.look("river").locked
    assert (workspace.layer, workspace.label) == ("hill", 1)
    workspace.use_label("dune", 5)  # neither painted nor declared
    assert {("dune", 5), ("dune", 1)} & set(places(layers)) == {("dune", 5)}
    workspace.use_label("hill", 2)
    assert ("dune", 5) not in places(layers)
    workspace.use_label("mountain", 1)
    layers.use_layer("hill")
    assert (workspace.layer, workspace.label) == ("hill", 2), "the layer's last label"


def test_keys_activate_layers_before_the_windows_shortcuts(layers, workspace):
    keys = Qt.Key
    assert all(overrides(layers.list, key) for key in (keys.Key_1, keys.Key_9, keys.Key_0))
    assert not any(overrides(layers.list, key) for key in (keys.Key_Colon, keys.Key_B))
    assert not overrides(layers.list, keys.Key_1, Qt.KeyboardModifier.ControlModifier)
    layers.list.setFocus()
    QTest.keyClick(layers.list, keys.Key_0)
    assert workspace.layer == "road"
    QTest.keyClick(layers.list, keys.Key_3)
    assert workspace.layer == "river"
    QTest.keyClick(layers.list, keys.Key_Down)
    assert (workspace.layer, workspace.label) == places(layers)[places(layers).index(("river", 1)) + 1]
    QTest.keyClick(layers.list, keys.Key_Space)
    assert not workspace.look("river").visible


def test_labels_are_added_deleted_and_cleared_unless_locked(layers, document, workspace):
    before = document.sketch
    workspace.use_label("mountain", 1)
    layers.add.click()
    assert ("mountain", workspace.label) in document.sketch.labels
    document.undo()
    workspace.use_label("hill", 2)
    layers.remove.click()
    assert 2 not in labels_in(document.sketch.layers["hill"])
    assert (workspace.layer, workspace.label) == ("hill", 1)
    document.undo()
    workspace.use_label("forest", 1)
    layers.clear.click()
    assert not document.sketch.layers["forest"].any()
    assert not layers.clear.isEnabled()
    document.undo()
    assert all(np.array_equal(document.sketch.layers[name], before.layers[name]) for name in PAINTED_LAYERS)
    messages = []
    document.message.connect(messages.append)
    workspace.set_look("forest", locked=True)
    layers.clear_layer()
    layers.delete_label()
    assert all(np.array_equal(document.sketch.layers[name], before.layers[name]) for name in PAINTED_LAYERS)
    assert messages == ["Forests are locked"] * 2


def test_opacity_and_menu_apply_to_the_active_layer(layers, workspace):
    workspace.set_look("hill", opacity=0.2)
    workspace.use_label("hill", 1)
    assert layers.opacity.value() == 200
    layers.opacity.setValue(500)
    assert (workspace.look("hill").opacity, workspace.look("mountain").opacity) == (0.5, 0.75)
    for visible in (["river"], list(LAYERS)):
        workspace.show_only("river")
        assert [name for name in LAYERS if workspace.look(name).visible] == visible
    menu = layers.menu()
    next(each for each in menu.actions() if "Hide" in each.text()).trigger()
    assert not workspace.look("hill").visible


def test_every_declared_parameter_and_overlay_has_a_control(properties, world, view, document, workspace):
    for layer in LAYERS:
        workspace.use_label(layer, 1)
        form = properties.label_page.form
        assert form.isVisible(), layer
        assert list(form.rows) == list(LAYERS[layer].parameters), layer
        for name, value in document.sketch.properties(layer, 1).items():
            is_default = value == LAYERS[layer].parameters[name].default
            assert form.rows[name].reset.isVisible() != is_default, (layer, name)
    tables = {(table, name) for table, form in world.forms.items() for name in form.rows}
    tables |= {("weather", name) for name in view.weather.rows}
    tables |= {("base", name) for name in BasePanel(document, SketchElevation(document)).form.rows}
    assert tables == {(table, name) for table, parameters in TABLES.items() for name in parameters}
    assert {*world.top.rows, "seed", "fidelity"} == set(SKETCH)
    assert set(OVERLAY_TITLES) == set(OVERLAYS)


def test_an_edit_is_an_undo_step_and_reset_removes_the_key(properties, document, workspace):
    workspace.use_label("mountain", 2)
    row = properties.label_page.form.rows["height"]
    row.box.setValue(777.0)
    assert document.sketch.properties("mountain", 2)["height"] == 777.0
    assert document.history.titles[-1] == "Set height of mountains 2"
    document.undo()
    assert row.box.value() == document.sketch.properties("mountain", 2)["height"]
    workspace.use_label("mountain", 1)
    row.reset.click()
    assert "height" not in document.sketch.labels["mountain", 1]
    assert row.check.isChecked()
    assert not row.reset.isVisible()
    row.check.click()
    assert document.sketch.labels["mountain", 1]["height"] == 340.0, "the previous height"
    row.check.click()
    assert document.sketch.properties("mountain", 1)["height"] == 0.0


def test_a_slider_drag_is_one_live_undo_step(properties, document, workspace):
    workspace.use_label("mountain", 1)
    row = properties.label_page.form.rows["height"]
    live = []
    document.live_changed.connect(lambda: live.append(document.sketch.properties("mountain", 1)["height"]))
    row.slider.setSliderDown(True)
    for value in range(400, 500, 10):
        row.slider.setValue(value)
    row.slider.setSliderDown(False)
    assert document.history.position == 1
    assert len(set(live)) == 10
    assert row.box.value() == document.sketch.properties("mountain", 1)["height"]
    # The drag passes the value of the opened sketch.
    row = properties.label_page.form.rows["peakiness"]
    row.slider.setSliderDown(True)
    for value in (550, 600, 650):
        row.slider.setValue(value)
        assert row.slider.value() == value
        assert document.sketch.properties("mountain", 1)["peakiness"] == round(value / 1000, 2)


def test_pending_text_applies_to_the_previous_selection(properties, document, workspace, placed, mountain):
    row = properties.selection_page.form.rows["radius"]
    typed(row.box, "123")
    workspace.selection = Selection("feature", int(placed.points["id"][placed.points["type"] == 0][1]))
    assert [(edit.feature, edit.radius) for edit in document.sketch.edits] == [(int(mountain["id"]), 123.0)]
    document.undo()
    workspace.selection = None
    for other in (("mountain", 2), ("material", 1), ("hill", 1)):
        workspace.use_label("mountain", 1)
        before = document.sketch.properties(*other)
        typed(properties.label_page.form.rows["height"].box, "901")
        workspace.use_label(*other)  # as the pick tool does, without a focus change
        assert document.sketch.properties("mountain", 1)["height"] == 901.0
        assert document.sketch.properties(*other) == before
        document.undo()


def test_numbers_of_a_selected_feature_become_edits(properties, document, mountain, workspace):
    rows = properties.selection_page.form.rows
    assert not properties.label_page.isVisible()
    assert "density" not in rows
    columns = (("x", "x", "move"), ("radius", "radius", "resize"), ("height", "strength", "strength"))
    for name, column, action in columns:
        assert rows[name].number == pytest.approx(float(mountain[column])), name
        rows[name].box.setValue(rows[name].box.value() + 25.0)
        expected = rows[name].box.value()
        (edit,) = document.sketch.edits
        assert edit.action == action
        assert expected in edit.values.values()
        assert rows[name].number == expected, "before it is placed"
        if name == "x":
            assert edit.y == pytest.approx(float(mountain["y"]), abs=0.001)
        document.undo()
    properties.back.click()
    assert workspace.selection is None
    assert properties.label_page.isVisible()


def test_lock_reset_and_delete_are_undo_steps(properties, document, mountain, workspace):
    page, selection = properties.selection_page, workspace.selection
    page.lock.click()
    assert is_locked(document.sketch, selection)
    document.undo()
    assert not page.lock.isChecked() | page.reset.isEnabled()
    for _ in range(2):
        page.lock.click()
    assert not is_locked(document.sketch, selection)
    page.form.rows["height"].box.setValue(50.0)
    page.reset.click()
    assert document.sketch.edits == ()
    page.delete.click()
    assert [edit.action for edit in document.sketch.edits] == ["delete"]
    assert workspace.selection is None
    assert len(document.history.titles) == 1 + 5


def test_a_vanished_selection_disables_its_page(properties, link, placed, mountain):
    page = properties.selection_page
    for placement, exists in ((dataclasses.replace(placed, points=placed.points[:0]), False), (placed, True)):
        link.placed = placement
        link.placed_changed.emit(placement)
        assert page.delete.isEnabled() == page.lock.isEnabled() == exists
        assert page.form.isVisible() == exists


def test_river_width_and_control_points_become_edits(properties, document, workspace, placed):
    river = max(placed.rivers, key=lambda each: len(each.points))
    workspace.selection = Selection("course", river.id)
    form = properties.selection_page.form
    width, east = form.rows["width"], form.rows["x"]
    assert width.number == pytest.approx(width_of(document.sketch, placed, workspace.selection))
    width.box.setValue(40.0)
    assert [(edit.action, edit.width) for edit in document.sketch.edits] == [("width", 40.0)]
    document.undo()
    assert not east.isEnabled()
    form.rows["point"].check.click()
    assert workspace.selection.index == 0
    form.rows["point"].box.setValue(2)
    assert east.number == river.points[1, 0]
    east.box.setValue(east.box.value() + 30.0)
    (edit,) = document.sketch.edits
    assert (edit.action, edit.x) == ("move_point", pytest.approx(east.box.value()))
    assert edit.y == pytest.approx(river.points[1, 1], abs=0.001)
    for each in placed.rivers:  # a confluence follows the parent river
        if find_parent_river(placed, each) is not None:
            workspace.selection = Selection("course", each.id, len(each.points) - 1)
            assert not form.rows["x"].isEnabled()
    workspace.selection = Selection("water", placed.lakes[0].id)
    assert form.isVisible()
    assert not form.rows
    assert properties.selection_page.delete.isEnabled()


def test_seeds_are_random_typed_or_previous(world, document):
    first = document.sketch.seed
    for _ in range(3):
        world.seed.dice.click()
    assert len({first, *world.seed.used}) == 4
    oldest = world.seed.previous.menu().actions()[-1]
    assert str(first) in oldest.text()
    oldest.trigger()
    assert document.sketch.seed == world.seed.used[0] == first
    most = 2**63 - 1
    for text, seed in ((str(most), most), ("x-9e99999999999999999999", most), ("12", 12)):
        typed(world.seed.field, text)
        QTest.keyClick(world.seed.field, Qt.Key.Key_Return)
        assert document.sketch.seed == seed, text
    document.open(load_sketch("alpine_range"))
    assert world.seed.used == (document.sketch.seed,)


def test_settings_are_titled_undo_steps_and_a_fidelity_drag_is_one(world, document):
    world.top.rows["extent"].box.setValue(8000.0)
    field = world.top.rows["name"].field
    typed(field, "Alps")
    QTest.keyClick(field, Qt.Key.Key_Return)
    assert document.history.titles[1:] == ("Set extent", "Set name")
    document.undo()
    assert field.text() == document.sketch.name != "Alps"
    world.top.rows["extent"].reset.click()
    assert document.sketch.extent == SKETCH["extent"].default
    document.go_to(0)
    live = []
    document.live_changed.connect(lambda: live.append(document.sketch.fidelity))
    world.fidelity.slider.setSliderDown(True)
    for value in (900, 500, 123):
        world.fidelity.slider.setValue(value)
    world.fidelity.slider.setSliderDown(False)
    assert live == [0.9, 0.5, 0.12]
    assert document.history.titles == ("Open", "Set fidelity")
    document.undo()
    assert world.fidelity.number == document.sketch.fidelity


def test_weather_edits_the_sketch_and_quality_the_view(qtbot, view, document, link):
    hour = view.weather.rows["hour"]
    hour.check.click()
    assert document.sketch.weather["hour"] == 12.0
    hour.slider.setValue(750)
    assert document.sketch.weather["hour"] == 18.0
    assert document.history.titles[-1] == "Set time of day"
    hour.reset.click()
    assert document.sketch.weather["hour"] == -1.0
    steps = len(document.history.titles)
    view.quality.check.click()
    view.quality.slider.setValue(300)
    view.quality.slider.setValue(800)
    assert link.requests == [], "until the slider rests"
    qtbot.waitUntil(lambda: link.requests == [ViewState(quality=0.8)])
    view.quality.reset.click()
    qtbot.waitUntil(lambda: link.view.quality is None)
    assert view.quality.check.isChecked()
    assert len(document.history.titles) == steps


def test_overlays_and_animation_set_the_view(view, link):
    view.overlays["features"].click()
    view.overlays["wireframe"].click()
    view.plays.click()
    assert link.view.overlays == ("features", "wireframe")
    assert not link.view.plays
    link.set_view(ViewState(overlays=("levels",), quality=0.25))
    boxes = (view.overlays["levels"], view.overlays["features"], view.plays, view.quality.check)
    assert [box.isChecked() for box in boxes] == [True, False, True, False]
    assert view.quality.box.value() == 0.25
