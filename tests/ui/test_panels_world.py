"""The world's and the view's settings."""

from __future__ import annotations

import pytest
from PyQt6.QtCore import Qt
from PyQt6.QtTest import QTest

from sketchterrain.sketch import SKETCH, TABLES, load_sketch
from sketchterrain.ui.commands.settings import setting
from sketchterrain.ui.engine.protocol import ViewState
from sketchterrain.ui.panels.view import OVERLAY_TITLES, ViewPanel
from sketchterrain.ui.panels.world import WorldPanel


@pytest.fixture
def world(qtbot, document):
    panel = WorldPanel(document)
    qtbot.addWidget(panel)
    panel.resize(300, 900)
    panel.show()
    return panel


@pytest.fixture
def view(qtbot, document, link):
    panel = ViewPanel(document, link)
    qtbot.addWidget(panel)
    panel.resize(300, 900)
    panel.show()
    return panel


def test_every_setting_and_overlay_has_a_control(world, view) -> None:
    shown = {(table, name) for table, form in world.forms.items() for name in form.rows}
    shown |= {("weather", name) for name in view.weather.rows}
    assert shown == {(table, name) for table, parameters in TABLES.items() for name in parameters}
    assert {*world.top.rows, "seed", "fidelity"} == set(SKETCH)

    from sketchterrain.render import OVERLAYS

    assert set(OVERLAY_TITLES) == set(OVERLAYS)


def test_dice_give_another_seed_and_earlier_ones_come_back(world, document):
    first = document.sketch.seed
    for _ in range(3):
        world.seed.dice.click()
    assert len({first, *world.seed.used}) == 4
    assert world.seed.used[-1] == first
    assert document.history.position == 3
    oldest = world.seed.earlier.menu().actions()[-1]
    assert str(first) in oldest.text()
    oldest.trigger()
    assert document.sketch.seed == first
    assert world.seed.used[0] == first
    assert len(world.seed.used) == 4


def test_dice_give_another_seed_and_earlier_ones_return(monkeypatch, world, document) -> None:
    from sketchterrain.ui.panels import world as seed_row

    monkeypatch.setattr(seed_row.random, "randrange", lambda _: document.sketch.seed)
    before = document.sketch.seed
    world.seed.dice.click()
    assert document.sketch.seed == before + 1

    world.seed.dice.click()
    document.open(load_sketch("alpine_range"))
    assert world.seed.used == (document.sketch.seed,)
    assert not world.seed.earlier.isEnabled()


def test_seed_and_name_are_typed(world, document) -> None:
    world.seed.field.selectAll()
    QTest.keyClicks(world.seed.field, "9223372036854775807")
    QTest.keyClick(world.seed.field, Qt.Key.Key_Return)
    assert document.sketch.seed == 2**63 - 1
    world.seed.field.selectAll()
    QTest.keyClicks(world.seed.field, "x-9e9999999999999999999999")  # what is no digit is not taken
    QTest.keyClick(world.seed.field, Qt.Key.Key_Return)
    assert document.sketch.seed == 2**63 - 1
    world.seed.field.clear()
    QTest.keyClick(world.seed.field, Qt.Key.Key_Return)
    assert document.sketch.seed == 0

    field = world.top.rows["name"].field
    field.selectAll()
    QTest.keyClicks(field, "Alps")
    QTest.keyClick(field, Qt.Key.Key_Return)
    assert document.sketch.name == "Alps"
    document.undo()
    assert field.text() == document.sketch.name


def test_a_setting_is_set_and_reset(world, document) -> None:
    for table in ["ground", "climate", "density"]:
        for name, row in world.forms[table].rows.items():
            default = TABLES[table][name].default
            row.edited.emit(TABLES[table][name].low, object())
            assert setting(document.sketch, table, name) == TABLES[table][name].low, table
            if setting(document.sketch, table, name) != default:
                row.reset.click()
            assert setting(document.sketch, table, name) == default, table


def test_fidelity_is_one_live_step_and_steps_are_titled(world, document) -> None:
    world.forms["climate"].rows["snow_line"].check.click()
    world.forms["density"].rows["forest"].box.setValue(3.0)
    world.top.rows["extent"].box.setValue(8000.0)
    assert document.history.titles[1:] == ("Set snow line", "Set density of groves", "Set extent")
    document.go_to(0)
    seen = []
    document.live_changed.connect(lambda: seen.append(document.sketch.fidelity))
    world.fidelity.slider.setSliderDown(True)
    for value in (900, 500, 123):
        world.fidelity.slider.setValue(value)
    world.fidelity.slider.setSliderDown(False)
    assert seen == [0.9, 0.5, 0.12]
    assert document.history.titles == ("Open", "Set fidelity")
    document.undo()
    assert world.fidelity.slider.value() == round(1000 * document.sketch.fidelity)


def test_a_group_folds(qtbot, world):
    from sketchterrain.ui.panels.parts import Group

    group = next(each for each in world.findChildren(Group) if each.text() == "Climate")
    assert not group.content().isVisible()
    group.toggleButton().setFocus()
    QTest.keyClick(group.toggleButton(), Qt.Key.Key_Space)
    assert group.content().isVisible()
    QTest.mouseClick(group.toggleButton(), Qt.MouseButton.LeftButton)
    assert not group.content().isVisible()


def test_weather_is_the_sketchs(view, document, link):
    view.weather.rows["hour"].check.click()
    assert document.sketch.weather["hour"] == 12.0
    view.weather.rows["hour"].slider.setValue(750)
    assert document.sketch.weather["hour"] == 18.0
    assert document.history.titles[-1] == "Set time of day"
    view.weather.rows["hour"].reset.click()
    assert document.sketch.weather["hour"] == -1.0
    assert link.told == []


def test_quality_is_the_views_and_is_told_when_the_slider_rests(qtbot, view, link, document):
    view.quality.check.click()
    view.quality.slider.setValue(300)
    view.quality.slider.setValue(800)
    assert link.told == []
    qtbot.waitUntil(lambda: bool(link.told), timeout=2000)
    assert link.told == [ViewState(quality=0.8)]
    view.quality.reset.click()
    qtbot.waitUntil(lambda: len(link.told) == 2, timeout=2000)
    assert link.view.quality is None
    assert view.quality.check.isChecked()
    assert len(document.history.titles) == 1


def test_overlays_and_motion_are_told_and_shown(view, link):
    view.overlays["features"].click()
    view.overlays["wireframe"].click()
    assert link.view.overlays == ("features", "wireframe")
    view.plays.click()
    assert not link.view.plays
    link.show(ViewState(overlays=("levels",), quality=0.25))
    assert view.overlays["levels"].isChecked()
    assert not view.overlays["features"].isChecked()
    assert view.plays.isChecked()
    assert view.quality.box.value() == 0.25
    assert not view.quality.check.isChecked()
