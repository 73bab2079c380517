"""The main window: actions, files, layout, messages."""

import io
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from PyQt6.QtCore import QEvent, QMimeData, QPointF, Qt, QUrl
from PyQt6.QtGui import QDropEvent, QImage, QKeySequence
from PyQt6.QtTest import QTest
from PyQt6.QtWidgets import QApplication, QFileDialog, QMenu, QMessageBox, QPushButton, QTabBar

from sketchterrain.document.label_layers import encode_layer
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import InputError
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.actions import MENUS
from sketchterrain.ui.app import _welcome
from sketchterrain.ui.banner import Message
from sketchterrain.ui.dialogs.start import RecoveryDialog
from sketchterrain.ui.engine.background import _render
from sketchterrain.ui.engine.protocol import ErrorReport, MeasureAdherence, RenderPicture
from sketchterrain.ui.look.theme import theme
from sketchterrain.ui.models.background import Autosave
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import TOOLS, Preferences, Selection, Workspace
from sketchterrain.ui.panels.properties import PropertiesPanel
from sketchterrain.ui.panels.settings import SeedRow
from sketchterrain.ui.window import MainWindow

from .conftest import FakeLink
from .events import LEFT, NO_KEYS, finish_reading, paint, pen, repeated_mnemonics
from .test_random_actions import UNTRIGGERED, DialogCloser

BUTTON = QMessageBox.StandardButton
PAINTED = (0, 0, 40, 40)


def do(window, name: str):
    window.actions_by_name[name].trigger()


def answer(monkeypatch, button) -> list[str]:
    questions = []

    monkeypatch.setattr(QMessageBox, "exec", lambda box: questions.append(box.text()) or button)
    return questions


def test_every_action_has_text_help_a_menu_and_a_shortcut_of_its_own(window):
    for action in window.actions_by_name:
        assert action.text(), action.objectName()
        assert action.statusTip(), action.objectName()
        assert action.toolTip().startswith("<p>")

    keys = [key.toString() for action in window.actions_by_name for key in action.shortcuts()]
    assert sorted(keys) == sorted(set(keys))
    assert all(QKeySequence(key).toString() for key in keys)

    def inside(menu: QMenu) -> set[str]:
        names = {action.objectName() for action in menu.actions()}
        return names.union(*(inside(action.menu()) for action in menu.actions() if action.menu()))

    bar = window.menuBar()
    listed = set().union(*(inside(action.menu()) for action in bar.actions()))
    assert {action.objectName() for action in window.actions_by_name} - listed == {"leave"}
    assert [action.text() for action in bar.actions()] == list(MENUS)

    for bar_action in bar.actions():
        assert not repeated_mnemonics(bar_action.menu().actions()), bar_action.text()


def test_zoom_brush_and_selection_actions_and_all_others_can_be_triggered(
    window, document, workspace, link, placed, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    scale, scales, brush, brushes = window.canvas.viewport.scale, [], workspace.brush, []
    for name in ("zoom-in", "zoom-out", "actual-size"):
        do(window, name)
        scales.append(window.canvas.viewport.scale)
    assert scales[0] > scale == pytest.approx(scales[1])
    assert scales[2] == 1.0
    for name in ("brush-larger", "brush-smaller"):
        do(window, name)
        brushes.append(workspace.brush)
    assert brushes == pytest.approx([1.25 * brush, brush])

    link.placed = placed
    link.placed_changed.emit(placed)
    workspace.selection = Selection("feature", int(placed.points["id"][0]))
    do(window, "lock-selection")
    assert [edit.action for edit in document.sketch.edits] == ["lock"]
    do(window, "delete-selection")
    assert [edit.action for edit in document.sketch.edits] == ["delete"]
    assert workspace.selection is None

    document.mark_saved(document.state, tmp_path / "a.sketch")
    for action in window.actions_by_name:
        if action.objectName() not in UNTRIGGERED and action.isEnabled():
            closer = DialogCloser()
            action.trigger()
            QApplication.processEvents()
            closer.stop()
    assert window.isVisible()
    assert window.banner.message is None or window.banner.message.kind != "error"


def test_tool_layer_overlay_and_engine_actions(window, workspace, link):
    window.activateWindow()
    for tool, key in zip(TOOLS, "VBELFIH", strict=True):
        do(window, f"tool-{tool}")
        assert workspace.tool == tool
        assert window.actions_by_name[f"tool-{tool}"].shortcut().toString() == key
    for name in LAYERS:
        do(window, f"layer-{name}")
        assert workspace.layer == name

    do(window, "show-layer")
    assert not workspace.look(workspace.layer).visible
    do(window, "only-layer")
    assert [name for name in LAYERS if workspace.look(name).visible] == [workspace.layer]
    do(window, "only-layer")
    assert all(workspace.look(name).visible for name in LAYERS)
    do(window, "lock-layer")
    assert workspace.look(workspace.layer).locked

    do(window, "measure")
    assert MeasureAdherence() in link.requests
    assert "adherence" in workspace.overlays
    assert window.actions_by_name["overlay-adherence"].isChecked()

    do(window, "restart")
    assert link.running


def test_save_as_then_save_then_open_recent(window, document, tmp_path, monkeypatch, qtbot):
    mine = str(tmp_path / "mine")
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (mine, _[4].split(";;")[0]))
    paint(document, "mountain", PAINTED)
    do(window, "save")
    qtbot.waitUntil(lambda: not document.is_modified)
    path = tmp_path / "mine.sketch"
    assert document.path == path
    assert load_sketch(path).layers["mountain"][:40, :40].all()
    assert window.windowTitle().startswith(document.sketch.name)
    assert not window.isWindowModified()
    do(window, "random-seed")
    assert window.isWindowModified()
    do(window, "save")
    qtbot.waitUntil(lambda: not document.is_modified)
    assert load_sketch(path).seed == document.sketch.seed
    document.open(Sketch())
    window.files.open(window.files.recent.paths[0])
    qtbot.waitUntil(lambda: document.path == path)
    assert document.sketch.layers["mountain"][:40, :40].all()


def test_missing_and_broken_sketches_are_reported_in_one_line(window, tmp_path, qtbot, document):
    before, gone, bad = document.sketch, tmp_path / "gone.sketch", tmp_path / "bad.sketch"
    window.files.recent.add(gone)
    bad.write_bytes(b"no zip")
    for path in (gone, bad):
        window.files.open(path)
        qtbot.waitUntil(lambda: window.banner.message is not None)
        assert path.name in window.banner.message.line
        assert "\n" not in window.banner.message.line
        window.banner.dismiss()
    assert gone not in window.files.recent.paths
    assert document.sketch is before


def test_the_newest_sketch_is_opened_and_reading_can_be_cancelled(window, document, tmp_path, qtbot):
    for name in ("one", "two"):
        save_sketch(Sketch(name=name), tmp_path / f"{name}.sketch")
        window.files.open(tmp_path / f"{name}.sketch")
    qtbot.waitUntil(lambda: document.sketch.name == "two")
    finish_reading()
    assert document.sketch.name == "two"

    done, before = threading.Event(), document.sketch
    window.files.reading.read(lambda: done.wait(300) and Sketch(), document.open)
    qtbot.waitUntil(lambda: window.banner.message is not None)
    assert window.banner.message.line.startswith("Reading")
    window.banner.message.buttons[0][1]()
    assert window.banner.message is None
    assert not window.files.reading.is_busy
    done.set()
    finish_reading()
    assert document.sketch is before


def test_the_export_dialog_is_not_modal_and_closes_with_the_window(window):
    from sketchterrain.ui.dialogs.export import ExportDialog

    do(window, "export")
    do(window, "export")
    (dialog,) = window.findChildren(ExportDialog)
    assert dialog.isVisible()
    assert not dialog.isModal()
    do(window, "undo")
    assert window.close()
    assert dialog.isHidden()


def test_pictures_are_saved_as_displayed_or_rendered(window, link, tmp_path, monkeypatch, qtbot):
    from sketchterrain.ui.dialogs.start import PictureDialog

    monkeypatch.setattr(PictureDialog, "exec", lambda dialog: dialog._ask_path() or 1)

    def save_as(path):
        monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(path), ""))
        do(window, "save-picture")

    save_as(tmp_path / "best.png")
    assert RenderPicture(str(tmp_path / "best.png"), 1280, 720) in link.requests
    window.banner.dismiss()

    link.picture = QImage(40, 30, QImage.Format.Format_RGB32)
    link.picture.fill(0xFF336699)
    save_as(tmp_path / "view")
    qtbot.waitUntil(lambda: window.banner.message is not None)
    assert window.banner.message.kind == "good"
    assert QImage(str(tmp_path / "view.png")).size() == link.picture.size()
    save_as(tmp_path / "nowhere" / "view.png")
    qtbot.waitUntil(lambda: window.banner.message.kind == "error")
    assert "cannot be written" in window.banner.message.line
    save_sketch(Sketch(), tmp_path / "mine")
    save_as(tmp_path / "mine" / "view.png")
    qtbot.waitUntil(lambda: "holds a sketch.toml" in window.banner.message.line)
    with pytest.raises(InputError, match=r"holds a sketch\.toml"):
        _render(SimpleNamespace(path=str(tmp_path / "mine" / "best.png")))
    assert not (tmp_path / "mine" / "view.png").exists()


def test_closing_asks_about_unsaved_changes_only(window, document, tmp_path, monkeypatch):
    path = tmp_path / "a.sketch"
    cases = ((BUTTON.Cancel, False, False), (BUTTON.Discard, True, False), (BUTTON.Save, True, True))
    for button, leaves, saves in cases:
        window.show()
        document.open(Sketch())
        save_sketch(document.sketch, path)
        document.mark_saved(document.state, path)
        paint(document, "mountain", PAINTED)
        questions = answer(monkeypatch, button)
        assert window.close() is leaves, button
        assert len(questions) == 1
        assert bool(load_sketch(path).layers["mountain"][:40, :40].all()) is saves, button
    window.show()
    assert window.close()
    assert len(questions) == 1


@pytest.fixture
def other(qtbot, tmp_path):
    """A second window with its own document, as of another program."""
    document = Document(Sketch())
    window = MainWindow(
        document, Workspace(), FakeLink(document), Preferences(tmp_path / "other.ini"), tmp_path
    )
    qtbot.addWidget(window, before_close_func=lambda _: document.open(Sketch()))
    window.show()
    return window


def activate(window, qtbot):
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)


@pytest.mark.parametrize("name", ["shared.sketch", "shared"])
def test_two_windows_that_save_one_file_lose_no_stroke(window, other, tmp_path, monkeypatch, qtbot, name):
    path, windows = tmp_path / name, (window, other)
    save_sketch(Sketch(), path)

    def press_save(one, button=None):
        """Press Ctrl+S and answer the question that is expected, if any."""
        questions = answer(monkeypatch, button)
        activate(one, qtbot)
        QTest.keyClick(one, Qt.Key.Key_S, Qt.KeyboardModifier.ControlModifier)
        one.files._saving.wait()
        finish_reading()
        assert questions == [f"{name} was changed on disk by another program."] * (button is not None)

    def layers() -> set[str]:
        return {layer for layer, image in load_sketch(path).layers.items() if image.any()}

    for one in windows:
        one.files.open(path)
        qtbot.waitUntil(lambda one=one: one._document.path == path)
    paint(window._document, "hill", PAINTED)
    paint(other._document, "lake", PAINTED)
    press_save(window)
    press_save(other, BUTTON.Cancel)
    assert layers() == {"hill"}
    assert other._document.is_modified
    assert not other.close()
    press_save(other, BUTTON.Yes)
    assert layers() == {"lake"}
    paint(window._document, "dune", PAINTED)
    press_save(window, BUTTON.Reset)
    assert not window._document.is_modified
    assert window._document.sketch.layers["lake"].any()
    paint(window._document, "dune", PAINTED)
    press_save(window)
    press_save(window)
    assert layers() == {"lake", "dune"}


def test_a_change_on_disk_is_reported_once_and_asked_about_on_closing(
    window, other, document, tmp_path, monkeypatch, qtbot
):
    path, answers = tmp_path / "shared.sketch", []
    monkeypatch.setattr(QMessageBox, "exec", lambda _: answers.pop(0))

    def reported() -> list[str]:
        """Return the titles of the buttons of the message that is shown on the window's next focus."""
        for one in (other, window):
            activate(one, qtbot)
        return [title for title, _ in window.banner.message.buttons] if window.banner.message else []

    save_sketch(Sketch(), path)
    window.files.open(path)
    qtbot.waitUntil(lambda: document.path == path)
    os.utime(path, (1, 1))
    assert reported() == []
    save_sketch(Sketch(seed=7), path)
    assert reported() == ["Reload", "Save as…"]
    assert window.banner.message.line == "shared.sketch was changed on disk by another program."
    window.banner.dismiss()
    assert reported() == []
    save_sketch(Sketch(seed=8), path)
    assert reported()
    window.banner.findChildren(QPushButton)[0].click()
    qtbot.waitUntil(lambda: document.sketch.seed == 8)
    assert window.banner.message is None

    save_sketch(Sketch(seed=9), path)
    paint(document, "hill", PAINTED)
    answers += [BUTTON.Save, BUTTON.Cancel]
    assert not window.close()
    assert load_sketch(path).seed == 9
    answers += [BUTTON.Save, BUTTON.Yes]
    assert window.close()
    assert load_sketch(path).seed == 8
    window.show()
    path.unlink()
    paint(document, "lake", PAINTED)
    answers += [BUTTON.Save]
    assert window.close()
    assert load_sketch(path).layers["lake"].any()
    assert answers == []


def test_a_recovered_sketch_does_not_replace_a_newer_file(window, document, tmp_path, monkeypatch):
    path, folder = tmp_path / "mine.sketch", tmp_path / "recovery"
    monkeypatch.setattr(RecoveryDialog, "exec", lambda _: 1)
    for newer in (False, True):
        save_sketch(Sketch(), path)
        lost = Document(Sketch())
        crashed = Autosave(lost, folder)
        lost.open(Sketch(seed=5), path, modified=True)
        crashed.wait()
        crashed._lock.release()
        if newer:
            save_sketch(Sketch(seed=6), path)
            os.utime(path, (1, 1))  # the content counts
        autosave = Autosave(document, folder)
        _welcome(window, document, autosave, is_new=False)
        assert (document.sketch.seed, document.path, document.is_modified) == (5, path, True)
        questions = answer(monkeypatch, BUTTON.Cancel)
        do(window, "save")
        window.files._saving.wait()
        assert len(questions) == newer
        assert load_sketch(path).seed == (6 if newer else 5)
        autosave.close()


def press(key):
    """Press a key where the focus is."""
    QTest.keyClick(QApplication.focusWidget(), key)


def point_at(widget):
    """Move the pointer to the middle of a widget."""
    QTest.mouseMove(widget.window().windowHandle(), widget.mapTo(widget.window(), widget.rect().center()))
    QApplication.processEvents()


@pytest.fixture
def height(window, workspace, qtbot):
    """The number field of the height of mountains 1, which is being edited."""
    activate(window, qtbot)
    workspace.use_label("mountain", 1)
    field = window.findChild(PropertiesPanel).label_page.form.rows["height"].box
    QTest.mouseClick(field, LEFT)
    field.selectAll()
    QTest.keyClicks(field, "500")
    assert field.hasFocus()
    return field


def set_height(document) -> float:
    return document.sketch.properties("mountain", 1)["height"]


def test_keys_after_enter_in_a_field_are_those_of_the_last_pane(window, document, workspace, link, height):
    point_at(window.view)
    point_at(window.canvas)
    press(Qt.Key.Key_0)
    assert height.hasFocus(), "a field that is edited keeps the focus"
    press(Qt.Key.Key_Return)
    assert window.canvas.hasFocus()
    press(Qt.Key.Key_3)
    QTest.mouseClick(window.canvas, LEFT)
    assert (workspace.layer, set_height(document)) == ("river", 5000.0)
    point_at(window.view)
    assert window.view.hasFocus()
    press(Qt.Key.Key_3)
    assert link.view.mode == "walk"
    assert workspace.layer == "river"
    seed = window.findChild(SeedRow).field
    window.panel_layout.show_panel("world")
    QTest.mouseClick(seed, LEFT)
    QTest.keyClick(seed, Qt.Key.Key_Enter)
    assert window.view.hasFocus()
    window.panel_layout.docks["view"].hide()
    assert window.canvas.hasFocus()


def test_a_click_on_a_pane_accepts_a_field(window, document, link, height):
    QTest.mouseClick(window.view, LEFT)
    press(Qt.Key.Key_2)
    assert (set_height(document), link.view.mode) == (500.0, "fly")
    QTest.keyClicks(height, "0")
    height.setFocus()
    pen(window.canvas, QEvent.Type.TabletPress, 20, 20, 0.5)
    assert window.canvas.hasFocus()


def test_hidden_fields_and_those_of_another_label_lose_the_focus(window, document, workspace, height):
    window.panel_layout.show_panel("world")
    QApplication.processEvents()
    assert window.canvas.hasFocus()
    assert set_height(document) == 500.0
    window.panel_layout.show_panel("properties")
    for change in (lambda: workspace.use_label("mountain", 2), lambda: workspace.use_label("hill", 1)):
        workspace.use_label("mountain", 1)
        height.setFocus()
        change()
        assert window.canvas.hasFocus()
    assert set_height(document) == 500.0


def test_the_pane_with_the_focus_is_outlined_and_a_line_goes_on_after_a_look_at_the_view(
    window, document, workspace, qtbot
):
    def edge(pane) -> str:
        return pane.grab().toImage().pixelColor(1, pane.height() // 2).name()

    activate(window, qtbot)
    accent = theme().accent.name()
    point_at(window.canvas)
    for pane, other_pane in ((window.view, window.canvas), (window.canvas, window.view)):
        point_at(pane)
        assert edge(pane) == accent != edge(other_pane)
    workspace.tool = "line"
    QTest.mouseClick(window.canvas, LEFT)
    steps = len(document.history.titles)
    point_at(window.view)
    assert (window.view.hasFocus(), len(document.history.titles)) == (True, steps)


def drop(window, *paths: Path):
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    window.dropEvent(QDropEvent(QPointF(5, 5), Qt.DropAction.CopyAction, data, LEFT, NO_KEYS))


def exchanged(data: bytes) -> bytes:
    """Return a palette PNG with the first two entries exchanged, which looks the same."""
    with Image.open(io.BytesIO(data)) as picture:
        moved = Image.fromarray(np.array([1, 0, *range(2, 256)], np.uint8)[np.asarray(picture)])
        palette = picture.getpalette()
    moved.putpalette([*palette[3:6], *palette[:3], *palette[6:]])
    stream = io.BytesIO()
    moved.save(stream, format="PNG")
    return stream.getvalue()


def test_dropped_sketches_are_opened_and_images_become_layers_in_one_step(window, document, tmp_path, qtbot):
    save_sketch(Sketch(name="Dropped"), tmp_path / "dropped")
    drop(window, tmp_path / "dropped" / "sketch.toml")
    qtbot.waitUntil(lambda: document.sketch.name == "Dropped")
    assert document.path == tmp_path / "dropped"

    shape = document.sketch.layers["hill"].shape
    hill, lake = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    hill[3:9, 4:8], lake[100:120] = 2, 1
    save_sketch(Sketch(layers={"hill": hill, "lake": lake}), tmp_path / "images")
    steps = len(document.history.titles)
    drop(window, tmp_path / "images" / "hill.png", tmp_path / "images" / "lake.png")
    qtbot.waitUntil(lambda: len(document.history.titles) > steps)
    assert len(document.history.titles) == steps + 1
    assert np.array_equal(document.sketch.layers["hill"], hill)
    assert np.array_equal(document.sketch.layers["lake"], lake)

    Image.fromarray(np.array(LAYERS["hill"].colour, np.uint8)[None, None] * hill[..., None].clip(0, 1)).save(
        tmp_path / "images" / "hill.png"
    )
    (tmp_path / "images" / "lake.png").write_bytes(exchanged(encode_layer(lake, LAYERS["lake"].colour)))
    for path in (tmp_path / "images", tmp_path / "images" / "lake.png"):
        document.do("Clear", document.sketch.replace(layers={}))
        document.mark_saved(document.state, tmp_path / "saved")  # no question when another is opened
        drop(window, path)
        qtbot.waitUntil(lambda: "colours decide" in getattr(window.banner.message, "line", ""))
        assert window.banner.message.kind == "warning"
        assert np.array_equal(document.sketch.layers["lake"], lake)
        window.banner.dismiss()
    save_sketch(Sketch(layers={"hill": np.zeros((8, 9), np.uint8)}), tmp_path / "small")
    drop(window, tmp_path / "small" / "hill.png")
    problem = "9×8 px: expected 512×512 px"
    qtbot.waitUntil(lambda: problem in getattr(window.banner.message, "line", ""))


def test_parts_are_maximised_and_restored(window):
    layout = window.panel_layout
    visible = {name for name, dock in layout.docks.items() if not dock.isHidden()}
    do(window, "view-only")
    assert not window.canvas.isVisible()
    assert [name for name, dock in layout.docks.items() if not dock.isHidden()] == ["view"]
    assert window.actions_by_name["leave"].isEnabled()
    do(window, "canvas-only")
    assert window.canvas.isVisible()
    assert all(dock.isHidden() for dock in layout.docks.values())
    do(window, "leave")
    assert window.canvas.isVisible()
    assert {name for name, dock in layout.docks.items() if not dock.isHidden()} == visible
    assert not window.actions_by_name["leave"].isEnabled()


def test_layout_is_stored_and_can_be_reset(window, open_window, tmp_path):
    window.panel_layout.docks["history"].close()
    window.panel_layout.docks["view"].setFloating(True)
    assert window.close()
    again = open_window()
    docks = again.panel_layout.docks
    assert docks["history"].isHidden()
    assert docks["view"].isFloating()
    do(again, "reset-layout")
    assert not docks["history"].isHidden()
    assert not docks["view"].isFloating()
    do(again, "canvas-only")
    assert again.close(), "the layout before maximising is stored"
    again.show()
    do(again, "leave")
    assert again.panel_layout.restore(Preferences(tmp_path / "desktop.ini").layout[1])
    assert not docks["view"].isHidden()


def test_messages_stay_above_the_canvas_when_another_tab_is_shown(window, qtbot):
    window.banner.show_message(Message("info", "one"))
    (tabs,) = (bar for bar in window.findChildren(QTabBar) if "World" in map(bar.tabText, range(bar.count())))
    tabs.setCurrentIndex((tabs.currentIndex() + 1) % tabs.count())
    assert window.children().index(window.canvas) > window.children().index(window.banner), "Qt has changed"
    qtbot.waitUntil(lambda: window.children().index(window.canvas) < window.children().index(window.banner))


def test_errors_are_messages_that_queue(window, link, capsys):
    banner = window.banner
    banner.show_message(Message("error", "one", "a"))
    banner.show_message(Message("warning", "two", "b"))
    banner.show_message(Message("warning", "three", "b"))
    assert banner.message.line == "three"
    banner.dismiss()
    assert banner.message.line == "one"
    banner.withdraw("a")
    assert banner.message is None
    assert banner.isHidden()

    link.error_reported.emit(ErrorReport("engine", "The engine ended (signal 9)."))
    message = window.banner.message
    assert message.line == "The engine ended (signal 9)."
    assert not window.banner.isHidden()
    message.buttons[0][1]()
    assert link.running
    link.facts_changed.emit(link.facts)
    assert window.banner.message is None

    with pytest.raises(ZeroDivisionError) as raised:
        1 / 0  # noqa: B018
    window.uncaught_exceptions.handle(raised.type, raised.value, raised.tb)
    assert "division by zero" in window.banner.message.line
    assert window.isVisible()
    assert "Traceback" in capsys.readouterr().err
    assert window.banner.message.buttons[0][0] == "Details…"


@pytest.mark.slow
def test_the_window_and_its_dialogs_import_no_driver():
    drivers = {
        *("pyopencl", "moderngl", "matplotlib", "OpenEXR", "pyogrio", "zarr", "distributed"),
        *("sketchterrain.render", "sketchterrain.compute"),
    }
    code = (
        f"import sys; drivers = {drivers}; import sketchterrain.ui.window; "
        "print(*sorted({'rasterio', *drivers} & set(sys.modules))); "
        "from sketchterrain.ui.dialogs import export, world; "
        "[export.target_named(name) for name in export.TARGET_NAMES]; "
        "print(*sorted(drivers & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == []
