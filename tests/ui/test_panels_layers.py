"""The list of layers: rows, the label in use, eyes and locks, new and deleted labels."""

from __future__ import annotations

import numpy as np
import pytest
from PyQt6.QtCore import QPoint, Qt
from PyQt6.QtTest import QTest

from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.ui.commands.labels import label_areas, set_property
from sketchterrain.ui.panels.layer_list import EYE, LOCK, NAME
from sketchterrain.ui.panels.layers import AreaCount, LayersPanel


@pytest.fixture
def panel(qtbot, document, workspace):
    panel = LayersPanel(document, workspace)
    qtbot.addWidget(panel)
    panel.resize(300, 700)
    panel.show()
    return panel


def places(panel):
    return [(row.layer, row.label) for row in panel.list.rows]


def click(panel, place, column):
    item = panel.list.topLevelItem(places(panel).index(place))
    view = panel.list.viewport()
    at = panel.list.visualItemRect(item).center()
    x = panel.list.columnViewportPosition(column) + panel.list.columnWidth(column) // 2
    QTest.mouseClick(view, Qt.MouseButton.LeftButton, pos=QPoint(x, at.y()))


def test_rows_are_the_declared_layers_in_order_with_details_of_their_labels(panel, document) -> None:
    assert list(dict.fromkeys(layer for layer, _ in places(panel))) == list(LAYERS)
    for name in LAYERS:
        used = set(label_areas(document.sketch.layers[name])) | {
            label for layer, label in document.sketch.labels if layer == name
        }
        assert {label for layer, label in places(panel) if layer == name} == (used or {1})

    seen = set()
    for row in panel.list.rows:
        assert (row.visible is not None) == (row.layer not in seen)
        seen.add(row.layer)

    row = next(row for row in panel.list.rows if (row.layer, row.label) == ("mountain", 1))
    assert row.detail.startswith(f"{document.sketch.properties('mountain', 1)['height']:.0f} m · ")
    assert "km²" in row.detail
    document.do("Set height", set_property(document.sketch, "mountain", 1, "height", 1234.0))
    row = next(row for row in panel.list.rows if (row.layer, row.label) == ("mountain", 1))
    assert row.detail.startswith("1234 m")


def test_a_click_uses_a_label_which_is_marked_and_remembered(panel, workspace) -> None:
    click(panel, ("hill", 1), NAME)
    assert (workspace.layer, workspace.label) == ("hill", 1)
    workspace.use_label("forest", 1)
    assert panel.list.currentItem() is panel.list.topLevelItem(places(panel).index(("forest", 1)))
    workspace.use_label("dune", 5)  # one that is not there yet
    assert ("dune", 5) in places(panel)
    assert ("dune", 1) not in places(panel)
    workspace.use_label("hill", 1)
    assert ("dune", 5) not in places(panel)

    workspace.use_label("hill", 2)
    workspace.use_label("mountain", 1)
    panel.choose_layer("hill")
    assert (workspace.layer, workspace.label) == ("hill", 2)


def test_eyes_and_locks_are_turned_and_the_label_stays(panel, workspace):
    before = workspace.layer, workspace.label
    click(panel, ("hill", 1), EYE)
    click(panel, ("river", 1), LOCK)
    assert not workspace.look("hill").visible
    assert workspace.look("river").locked
    assert (workspace.layer, workspace.label) == before
    rows = {(row.layer, row.label): row for row in panel.list.rows}
    assert rows["hill", 1].visible is False
    assert rows["river", 1].locked is True
    click(panel, ("hill", 1), EYE)
    assert workspace.look("hill").visible


def test_keys_choose_and_are_kept_from_the_windows_shortcuts(qtbot, panel, workspace) -> None:
    from PyQt6.QtCore import QEvent
    from PyQt6.QtGui import QKeyEvent
    from PyQt6.QtWidgets import QApplication

    def is_kept(key, modifiers=Qt.KeyboardModifier.NoModifier):
        event = QKeyEvent(QEvent.Type.ShortcutOverride, key, modifiers)
        event.ignore()
        QApplication.sendEvent(panel.list, event)
        return event.isAccepted()

    assert is_kept(Qt.Key.Key_1)
    assert is_kept(Qt.Key.Key_7)
    assert not is_kept(Qt.Key.Key_8)
    assert not is_kept(Qt.Key.Key_1, Qt.KeyboardModifier.ControlModifier)
    assert not is_kept(Qt.Key.Key_B)

    panel.list.setFocus()
    QTest.keyClick(panel.list, Qt.Key.Key_3)
    assert workspace.layer == "river"
    QTest.keyClick(panel.list, Qt.Key.Key_Down)
    assert (workspace.layer, workspace.label) == places(panel)[places(panel).index(("river", 1)) + 1]
    QTest.keyClick(panel.list, Qt.Key.Key_Up)
    QTest.keyClick(panel.list, Qt.Key.Key_Space)
    assert not workspace.look("river").visible
    QTest.keyClick(panel.list, Qt.Key.Key_7)
    assert workspace.layer == "material"


def test_new_and_copied_labels_are_used_and_undone(panel, document, workspace) -> None:
    workspace.use_label("mountain", 1)
    labels = [label for layer, label in places(panel) if layer == "mountain"]
    panel.add.click()
    new = workspace.label
    assert new not in labels
    assert ("mountain", new) in document.sketch.labels
    assert document.history.titles[-1] == f"New mountains {new}"
    document.undo()
    assert ("mountain", new) not in document.sketch.labels
    assert ("mountain", new) in places(panel), "it is still painted with"
    workspace.use_label("mountain", 1)
    assert ("mountain", new) not in places(panel)

    workspace.use_label("mountain", 1)
    panel.copy_label()
    assert workspace.label != 1
    assert document.sketch.properties("mountain", workspace.label) == document.sketch.properties(
        "mountain", 1
    )


def test_a_deleted_label_and_a_cleared_layer_lose_their_paint_in_one_step(panel, document, workspace) -> None:
    workspace.use_label("hill", 2)
    before = document.sketch
    panel.remove.click()
    assert 2 not in label_areas(document.sketch.layers["hill"])
    assert (workspace.layer, workspace.label) == ("hill", 1)
    document.undo()
    assert np.array_equal(document.sketch.layers["hill"], before.layers["hill"])
    assert document.history.position == 0

    workspace.use_label("forest", 1)
    panel.clear.click()
    assert not document.sketch.layers["forest"].any()
    assert not panel.clear.isEnabled()
    assert document.history.titles[-1] == "Clear forests"


def test_a_locked_layer_is_kept(panel, document, workspace):
    workspace.use_label("forest", 1)
    workspace.set_look("forest", locked=True)
    before = document.sketch
    said = []
    panel.message.connect(said.append)
    assert not panel.clear.isEnabled()
    assert not panel.remove.isEnabled()
    panel.clear_layer()
    panel.delete_label()
    assert document.sketch is before
    assert said == ["Forests are locked"] * 2


def test_opacity_and_the_menu_are_those_of_the_layer_in_use(panel, workspace) -> None:
    workspace.set_look("hill", opacity=0.2)
    assert panel.opacity.value() == 750
    workspace.use_label("hill", 1)
    assert panel.opacity.value() == 200
    panel.opacity.setValue(500)
    assert workspace.look("hill").opacity == 0.5
    assert workspace.look("mountain").opacity == 0.75

    panel.show_only("river")
    assert [name for name in LAYERS if workspace.look(name).visible] == ["river"]
    panel.show_only("river")
    assert all(workspace.look(name).visible for name in LAYERS)

    workspace.use_label("hill", 1)
    texts = [action.text().replace("&", "") for action in panel.menu().actions() if action.text()]
    assert texts[:4] == ["New label", "Copy label", "Delete label", "Clear hills"]
    menu = panel.menu()
    next(each for each in menu.actions() if "Hide" in each.text()).trigger()
    assert not workspace.look("hill").visible


def test_sixteen_labels_are_all_that_one_can_add(qtbot, qapp, workspace):
    from sketchterrain.ui.models.document import Document

    image = np.arange(256, dtype=np.uint8).reshape(16, 16) % 17
    document = Document(Sketch(layers={"mountain": image}))
    panel = LayersPanel(document, workspace)
    qtbot.addWidget(panel)
    said = []
    panel.message.connect(said.append)
    assert not panel.add.isEnabled()
    panel.new_label()  # from a menu
    panel.copy_label()
    assert said == ["Mountains: a layer has at most 16 labels"] * 2
    assert document.history.position == 0
    workspace.use_label("hill", 1)
    assert panel.add.isEnabled()
    panel.clear_layer()
    panel.delete_label()
    assert said[2:] == ["No hills are painted", "There is nothing of hills 1 to delete"]


def test_large_images_are_counted_in_slices(qtbot):
    image = np.random.default_rng(1).integers(0, 4, (3000, 1500), dtype=np.uint8)
    count = AreaCount()
    counted = []
    count.counted.connect(lambda layer, areas: counted.append((layer, areas)))
    count.count({"hill": image})
    assert not counted
    newer = np.where(image == 2, np.uint8(1), image)
    count.count({"hill": newer})  # the newest counts
    qtbot.waitUntil(lambda: bool(counted), timeout=5000)
    qtbot.wait(50)
    assert counted == [("hill", label_areas(newer))]
    count.count({"hill": newer})
    qtbot.wait(20)
    assert len(counted) == 1
