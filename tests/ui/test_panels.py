"""Properties of all panels and views: accessible names, no side effects, no leaks."""

import gc
from collections import Counter

import pytest
from PyQt6 import QtWidgets
from PyQt6.QtCore import QCoreApplication, QEvent, QObject, Qt
from PyQt6.QtWidgets import QApplication, QWidget

from sketchterrain.document.store import load_sketch
from sketchterrain.ui.canvas.canvas import Canvas
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
