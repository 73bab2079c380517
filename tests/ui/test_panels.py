"""Properties of all panels and views; history, adherence and contradictions, and the status line."""

import dataclasses
import gc
from collections import Counter

import numpy as np
import pytest
from PyQt6 import QtWidgets
from PyQt6.QtCore import QCoreApplication, QEvent, QObject, QPoint, Qt
from PyQt6.QtTest import QTest
from PyQt6.QtWidgets import QApplication, QWidget

from sketchterrain.document.store import load_sketch
from sketchterrain.geometry.camera import Camera
from sketchterrain.ui.canvas.canvas import Canvas
from sketchterrain.ui.commands import WORLD, set_setting
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.models.elevation import SketchElevation
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.panels.base import BasePanel
from sketchterrain.ui.panels.layers import LayersPanel
from sketchterrain.ui.panels.lists import ContradictionsPanel, HistoryPanel
from sketchterrain.ui.panels.properties import PropertiesPanel
from sketchterrain.ui.panels.settings import ViewPanel, WorldPanel
from sketchterrain.ui.panels.status_line import AdherencePanel, StatusLine
from sketchterrain.ui.view3d.view import View3D

PANELS = {
    "layers": lambda document, workspace, _: LayersPanel(document, workspace),
    "properties": PropertiesPanel,
    "world": lambda document, _, __: WorldPanel(document),
    "base": lambda document, _, __: BasePanel(document, SketchElevation(document)),
    "history": lambda document, _, __: HistoryPanel(document),
    "view": lambda document, _, link: ViewPanel(document, link),
    "adherence": lambda _, workspace, link: AdherencePanel(workspace, link),
    "contradictions": lambda _, workspace, link: ContradictionsPanel(workspace, link),
    "status": StatusLine,
}
COMPOUND = (QtWidgets.QAbstractSpinBox, QtWidgets.QComboBox, QtWidgets.QAbstractItemView)
CONTROLS = (*COMPOUND, QtWidgets.QAbstractButton, QtWidgets.QAbstractSlider, QtWidgets.QLineEdit)


@pytest.fixture(params=PANELS)
def panel(request, show_widget, document, workspace, link):
    return show_widget(PANELS[request.param](document, workspace, link))


def display_states(workspace, link, placed):
    """Iterate over the labels and selections that panels display."""
    link.placed = placed
    link.placed_changed.emit(placed)
    for layer in ("mountain", "river", "forest", "material", "dune"):
        workspace.use_label(layer, 1)
        yield
    feature, river = (
        Selection("feature", int(placed.points["id"][0])),
        Selection("course", placed.rivers[0].id, 1),
    )
    for selection in (
        feature,
        river,
        Selection("water", placed.lakes[0].id),
        Selection("water", 12345),
        None,
    ):
        workspace.selection = selection
        yield


def parts(panel):
    """Yield the controls of a panel, without the inner parts of Qt's widgets."""
    for each in panel.findChildren(QWidget):
        inner = isinstance(each.parent(), COMPOUND) or each.window() is not panel.window()
        if isinstance(each, CONTROLS) and not inner and not isinstance(each, QtWidgets.QScrollBar):
            yield each


def test_every_control_has_name_tool_tip_and_keyboard_focus(panel, workspace, link, placed):
    for _ in display_states(workspace, link, placed):
        for control in parts(panel):
            assert control.accessibleName(), f"{control} has no name: {control.parent()}"
            assert control.toolTip(), f"{control.accessibleName()} has no tool tip"
            if control.isVisible() and control.isEnabled():
                assert control.focusPolicy() & Qt.FocusPolicy.TabFocus, control.accessibleName()


def test_displaying_any_state_changes_nothing(panel, document, workspace, link, placed):
    before, looks = document.sketch, [workspace.look(name) for name in document.sketch.layers]
    tool, overlays, view = workspace.tool, workspace.overlays, link.view
    active, brush = (workspace.layer, workspace.label), workspace.brush
    for _ in display_states(workspace, link, placed):
        QCoreApplication.processEvents()
    assert document.sketch is before
    assert len(document.history.titles) == 1
    assert [workspace.look(name) for name in document.sketch.layers] == looks
    workspace.use_label(*active)
    assert (workspace.tool, workspace.brush, workspace.overlays) == (tool, brush, overlays)
    assert link.view == view
    assert link.requests == []

    for name in ("alpine_range", "desert_mountains", "rolling_hills"):
        sketch = load_sketch(name)
        document.open(sketch)
        QCoreApplication.processEvents()
        assert document.sketch is sketch
        assert len(document.history.titles) == 1


def test_nothing_is_clipped_in_a_narrow_dock(panel, workspace, link, placed):
    if isinstance(panel, StatusLine):  # a line of the window, no dock
        assert panel.minimumSizeHint().width() <= 900
        return
    assert panel.minimumSizeHint().width() <= 220
    for _ in display_states(workspace, link, placed):
        QCoreApplication.processEvents()
        for control in parts(panel):
            if control.isVisible():
                left = control.mapTo(panel, control.rect().topLeft()).x()
                right = control.mapTo(panel, control.rect().topRight()).x()
                assert 0 <= left <= right < 300, control.accessibleName()


@pytest.mark.slow
def test_closed_widgets_leak_no_objects_or_connections(document, workspace, link, placed):
    def open_and_close(create):
        widget = create(document, workspace, link)
        widget.show()
        QCoreApplication.processEvents()
        widget.grab()
        widget.close()
        widget.deleteLater()
        del widget
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        QCoreApplication.processEvents()

    def living() -> tuple[Counter[type], Counter[type]]:
        gc.collect()
        objects = (type(each) for each in gc.get_objects())
        return Counter(map(type, QApplication.allWidgets())), Counter(
            kind for kind in objects if issubclass(kind, QObject)
        )

    def open_and_close_all():
        for number, _ in enumerate(display_states(workspace, link, placed)):
            if number in (5, 9):  # a feature is selected, a label is
                for create in (*PANELS.values(), View3D, Canvas):
                    open_and_close(create)

    open_and_close_all()
    before = living()
    open_and_close_all()
    assert living() == before
    for signal in (document.sketch_changed, document.history_changed, document.opened):
        signal.emit()  # no closed widget is connected
    workspace.overlays_changed.emit()
    link.placed_changed.emit(placed)


LAYER = {"shapes": 3, "measured": 2, "lost": 1, "iou_mean": 0.912, "spill": 0.051}
PEAKS = {"measured": 2, "limited": 1, "least": 0.9, "mean": 1.0, "median": 1.0, "most": 1.04}
NARROW = {"layer": "mountain", "label": 1, "asked": 600.0, "built": 253.2, "limited": True}
FIGURES = {"lost": 1, "mean_iou": 0.877, "layers": {"mountain": LAYER, "hill": {**LAYER, "shapes": 0}}}


def texts(panel):
    model = panel.list.model()
    return [model.index(row, 0).data() for row in range(model.rowCount())]


def test_history_marks_the_current_step_and_a_click_goes_to_a_step(show_widget, document):
    panel = show_widget(HistoryPanel(document))
    for seed in range(1, 6):
        document.do(f"Step {seed}", set_setting(document.sketch, WORLD, "seed", 1000 + seed))
    assert texts(panel) == ["Open", *(f"Step {n}" for n in range(1, 6))]
    assert panel.list.currentIndex().row() == 5
    document.go_to(3)
    assert panel.list.selectionModel().selectedIndexes()[0].row() == 3
    model = panel.list.model()
    pale = Qt.ItemDataRole.ForegroundRole
    assert [model.index(row, 0).data(pale) is not None for row in range(6)] == [False] * 4 + [True] * 2
    place = panel.list.visualRect(model.index(2, 0)).center()
    QTest.mouseClick(panel.list.viewport(), Qt.MouseButton.LeftButton, pos=place)
    assert (document.history.position, document.sketch.seed) == (2, 1002)
    assert len(document.history.titles) == 6
    QTest.keyClick(panel.list, Qt.Key.Key_End)
    assert document.history.position == 5


def test_adherence_is_measured_on_request_and_again_after_an_error(show_widget, workspace, link):
    panel = show_widget(AdherencePanel(workspace, link))
    panel.measure.click()
    link.error_reported.emit(msg.ErrorReport("engine", "it ended"))
    panel.measure.click()
    assert link.requests == [msg.MeasureAdherence()] * 2
    wide = {**NARROW, "built": 600.0, "limited": False}
    link.adherence = msg.Agreement(1, {**FIGURES, "peaks": PEAKS, "shapes": [NARROW, wide]})
    link.adherence_changed.emit(link.adherence)
    assert [name for name, bar in panel.bars.items() if bar.isVisible()] == ["mountain"]
    assert "91 % overlap. 3 shapes · 1 lost · spills over by 5 %" in panel.bars["mountain"].accessibleName()
    assert panel._peaks.text().splitlines() == [
        "Mountains and hills reach 90 to 104 % of the height built for them.",
        "Mountain 1: 600 m asked, 253 m built (1 shape too narrow)",
    ]
    thin = {**LAYER, "measured": 0, "iou_mean": None, "spill": None}
    link.adherence = msg.Agreement(1, {"mean_iou": None, "layers": {"hill": thin}, "peaks": None})
    link.adherence_changed.emit(link.adherence)
    assert "too thin to measure" in panel.bars["hill"].accessibleName()
    panel.grab()


def test_realism_is_shown_with_what_is_out_of_range(show_widget, workspace, link):
    panel = show_widget(AdherencePanel(workspace, link))
    assert not panel._realism.isVisible()
    hollows = {"title": "closed hollows, share", "value": 0.0712, "real": [0.0, 0.004, 0.03]}
    realism = {"distance": 1.913, "kind": "hills 90 m", "out_of_range": {"sink_share": hollows}}
    link.adherence = msg.Agreement(1, FIGURES, realism=realism)
    link.adherence_changed.emit(link.adherence)
    assert panel._realism_head.text() == "Realism: 1.91 from hills 90 m"
    assert "closed hollows, share: 0.0712, real land 0 to 0.03" in panel._realism.text()
    panel.faults.click()
    assert "realism" in workspace.overlays
    workspace.show_overlay("realism", False)
    assert not panel.faults.isChecked()


def test_adherence_is_updated_while_its_overlay_is_on(qtbot, show_widget, workspace, link, placed):
    panel = show_widget(AdherencePanel(workspace, link))
    link.placed = placed
    link.placed_changed.emit(placed)
    assert not panel._timer.isActive(), "not requested"
    panel.overlay.click()
    assert "adherence" in workspace.overlays
    qtbot.waitUntil(lambda: link.requests == [msg.MeasureAdherence()])
    link.adherence = msg.Agreement(placed.version, FIGURES)
    link.adherence_changed.emit(link.adherence)
    for version in (2, 3, 4):
        link.placed = dataclasses.replace(placed, version=version)
        link.placed_changed.emit(link.placed)
    qtbot.waitUntil(lambda: len(link.requests) == 2)


def test_contradictions_show_their_place_and_toggle_their_overlay(show_widget, workspace, link, placed):
    panel = show_widget(ContradictionsPanel(workspace, link))
    panel.mark.click()
    assert panel.mark.isChecked() == ("contradictions" in workspace.overlays)
    workspace.show_overlay("contradictions", not panel.mark.isChecked())
    assert panel.mark.isChecked() == ("contradictions" in workspace.overlays)
    assert not panel.list.isVisible()
    lines = (("river 1 crosses mountain 2: valley cut 84 m", 100.0, 200.0), ("lake 1 lies high", 5.0, 6.0))
    link.placed = dataclasses.replace(placed, resolutions=lines, orphans=("move of 4711",))
    link.placed_changed.emit(link.placed)
    assert texts(panel)[1:] == ["Lake 1 lies high", "Edit without its feature: move of 4711"]
    activated = []
    panel.place_activated.connect(lambda x, y: activated.append((x, y)))
    for row in range(3):
        place = panel.list.visualRect(panel.list.model().index(row, 0)).topLeft() + QPoint(30, 5)
        QTest.mouseClick(panel.list.viewport(), Qt.MouseButton.LeftButton, pos=place)
    assert activated == [(100.0, 200.0), (5.0, 6.0)]


@pytest.fixture
def line(show_widget, document, workspace, link):
    return show_widget(StatusLine(document, workspace, link), 1280)


def test_status_line_shows_activity_and_the_paint_under_the_pointer(line, link, document, workspace):
    for activity in ("Placing features", ""):
        link.activity = activity
        link.activity_changed.emit(activity)
        assert line.work.text() == line.work.accessibleName() == (activity or "Ready")
        assert line.busy.isVisible() == bool(activity)
    sketch = document.sketch
    row, column = np.argwhere((sketch.layers["mountain"] == 1) & (sketch.layers["river"] == 0))[0]
    place = ((column + 0.5) * sketch.pixel_size, (sketch.height_px - row - 0.5) * sketch.pixel_size, None)
    line.show_position(place)
    assert line.paint.text().startswith("Mountains 1")
    workspace.set_look("mountain", visible=False)
    line.show_position(place)
    assert "mountains" not in line.paint.text().lower()
    line.show_position((-5.0, 1e9, None))
    assert line.paint.text() == ""


def test_status_line_tells_the_depth_of_the_sea(line, link):
    flat = np.zeros((4, 4), np.float32)
    for level, elevation, expected in (
        (None, -3.0, "−3 m high"),
        (10.0, 12.0, "12 m high"),
        (10.0, 10.0, "sea"),
        (10.0, -2.0, "sea 12 m deep"),
    ):
        link.relief = msg.Relief(1, 1, flat, flat.astype(np.uint8), level)
        line.show_position((1.0, 2.0, elevation))
        assert line.place.text().endswith(f"  {expected}")


def test_status_labels_keep_their_positions(qtbot, line, link, placed):
    def places():
        line.layout().activate()
        return [each.geometry() for each in (line.place, line.paint, line.frame, line.memory, line.device)]

    before, pose = places(), Camera((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    link.placed = dataclasses.replace(placed, seconds=0.12)
    link.frame = msg.FrameFacts(800, 600, 1, pose, 0.08, 0.021, 120, 400_000, True, 500_000_000)
    link.frame_shown.emit(link.frame)
    link.activity = "Measuring how far the terrain does what the sketch says"
    link.activity_changed.emit(link.activity)
    line.show_position((1.0, 2.0, -3.0))
    qtbot.waitUntil(lambda: line.frame.text() == "Frame 80 ms, 12/s")
    assert places() == before
