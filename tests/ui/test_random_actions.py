"""Random actions in the window leave no exception, no widget and no memory behind."""

import ctypes
import gc
import os
import random
import sys
from collections import Counter
from pathlib import Path

import pytest
from PyQt6 import QtWidgets
from PyQt6.QtCore import QEvent, QPoint, Qt, QTimer
from PyQt6.QtTest import QTest
from PyQt6.QtWidgets import QAbstractItemView, QAbstractSlider, QAbstractSpinBox, QApplication, QComboBox

from sketchterrain.document.store import load_sketch
from sketchterrain.io.resources import preset_names
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.models.workspace import OVERLAYS, TOOLS

from .events import wheel

_NAMES = "BracketLeft BracketRight Escape Delete Return Left Up Tab W Space"
_KEYS = [getattr(Qt.Key, f"Key_{name}") for name in _NAMES.split()]
_MOVES = [getattr(Qt.Key, f"Key_{name}") for name in ["Up", "Down", "PageUp", "PageDown", "Home"]]
_BUTTONS = (Qt.MouseButton.LeftButton, Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton)
UNTRIGGERED = ("quit", "restart", "full-screen")
"""Actions that would end the test or start the engine."""


class Monkey:
    """Performs random user actions, reproducible by seed."""

    def __init__(self, window, document, workspace, *, seed: int):
        self._window, self._document, self._workspace = window, document, workspace
        self._random = random.Random(seed)
        self._sketches = [load_sketch(name) for name in preset_names()]
        self.log: list[str] = []

    def act(self):
        often = {self.paint: 8, self.use_history: 4, self.turn_form: 4, self.trigger: 3, self.choose: 3}
        often |= {self.press: 2, self.scroll: 2}
        often |= dict.fromkeys((self.resize, self.dock, self.load, self.look_around), 1)
        (action,) = self._random.choices([*often], [*often.values()])
        self.log.append(action.__name__)
        action()
        QApplication.processEvents()

    def paint(self):
        self._drag(self._window.canvas)

    def look_around(self):
        self._drag(self._window.view)

    def use_history(self):
        what = self._random.choice(("undo", "redo", "go"))
        if what == "go":
            self._document.go_to(self._random.randrange(len(self._document.history.titles)))
        else:
            self._window.actions_by_name[what].trigger()

    def trigger(self):
        """Trigger a menu action; dialogs are closed at once."""
        actions = [each for each in self._window.actions_by_name if each.objectName() not in UNTRIGGERED]
        action = self._random.choice(actions)
        self.log[-1] += f" {action.objectName()}"
        if action.isEnabled():
            closing = DialogCloser()
            action.trigger()
            QApplication.processEvents()
            closing.stop()

    def turn_form(self):
        kinds = (QAbstractSlider, QAbstractSpinBox, QComboBox, QAbstractItemView)
        controls = [each for kind in kinds for each in self._window.findChildren(kind) if each.isVisible()]
        buttons = [
            each
            for dock in self._window.findChildren(QtWidgets.QDockWidget)
            for each in dock.findChildren(QtWidgets.QAbstractButton)
            if each.isVisible() and each.isEnabled()
        ]
        control = self._random.choice([*controls, *buttons])
        self.log[-1] += f" {type(control).__name__} {control.accessibleName()}"
        closing = DialogCloser()
        if isinstance(control, QtWidgets.QAbstractButton):
            QTest.mouseClick(control, Qt.MouseButton.LeftButton)
        else:
            for _ in range(self._random.randrange(1, 4)):
                QTest.keyClick(control, self._random.choice(_MOVES))
        QApplication.processEvents()
        closing.stop()

    def press(self):
        target = self._random.choice((self._window.canvas, self._window.view))
        QTest.keyClick(target, self._random.choice(_KEYS))

    def scroll(self):
        target = self._random.choice((self._window.canvas, self._window.view))
        place = self._place(target)
        keys = self._random.choice((Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ShiftModifier))
        wheel(target, place.x(), place.y(), self._random.choice((-2, -1, 1, 2)), keys)

    def choose(self):
        """Change tool, label, brush, overlay or a layer's look."""
        dice, workspace = self._random, self._workspace
        layer = dice.choice(list(LAYERS))
        what = dice.randrange(5)
        if what == 0:
            workspace.tool = dice.choice(TOOLS)
        elif what == 1:
            workspace.use_label(layer, dice.randrange(1, 4))
        elif what == 2:
            workspace.brush = dice.uniform(0.5, 60.0)
        elif what == 3:
            workspace.set_look(layer, visible=dice.random() < 0.8, locked=dice.random() < 0.2)
        else:
            workspace.show_overlay(dice.choice(list(OVERLAYS)), dice.random() < 0.6)

    def resize(self):
        self._window.resize(self._random.randrange(720, 1700), self._random.randrange(480, 1000))

    def dock(self):
        dock = self._random.choice(self._window.findChildren(QtWidgets.QDockWidget))
        what = self._random.randrange(3)
        if what == 2:
            dock.setFloating(not dock.isFloating())
        else:
            dock.setVisible(what == 1)

    def load(self):
        """Open another sketch, once in four times: it is slow."""
        if self._random.random() < 0.25:
            self._document.open(self._random.choice(self._sketches))

    def _drag(self, widget):
        if not widget.isVisible():
            return
        button = self._random.choice(_BUTTONS)
        place = self._place(widget)
        closing = DialogCloser()  # a right click may open a menu
        QTest.mousePress(widget, button, Qt.KeyboardModifier.NoModifier, place)
        for _ in range(self._random.randrange(6)):
            place += QPoint(self._random.randrange(-60, 61), self._random.randrange(-60, 61))
            QTest.mouseMove(widget, place)
        QTest.mouseRelease(widget, button, Qt.KeyboardModifier.NoModifier, place)
        QApplication.processEvents()
        closing.stop()

    def _place(self, widget) -> QPoint:
        width, height = max(widget.width(), 1), max(widget.height(), 1)
        return QPoint(self._random.randrange(width), self._random.randrange(height))


class DialogCloser:
    """Closes dialogs and menus until it is stopped."""

    def __init__(self):
        self._timer = QTimer()
        self._timer.timeout.connect(self._close)
        self._timer.start(0)

    def stop(self):
        self._close()
        self._timer.stop()

    @staticmethod
    def _close():
        for widget in (QApplication.activePopupWidget(), QApplication.activeModalWidget()):
            if widget is not None:
                widget.close()
        for menu in QApplication.topLevelWidgets():
            if isinstance(menu, (QtWidgets.QMenu, QtWidgets.QDialog)) and menu.isVisible():
                menu.close()


WARM = 0.5
"""Share of the actions before the first measurement, in which caches fill."""
GROWTH = 1.05
"""Largest allowed ratio of resident memory after and before."""


@pytest.fixture
def window(window, link, placed):
    link.placed = placed
    link.placed_changed.emit(placed)
    return window


def settle():
    """Process deferred deletions."""
    for _ in range(3):
        QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        QApplication.processEvents()
        gc.collect()


def resident() -> int:
    """Return the resident bytes of this process, without the allocator's free memory."""
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def widgets() -> Counter[str]:
    """Count all widgets by class and parent."""

    def name(widget) -> str:
        return f"{type(widget).__name__} {widget.objectName()}".rstrip()

    kinds = ((each, each.parentWidget()) for each in QApplication.allWidgets())
    return Counter(f"{name(each)} in {name(parent) if parent else 'nothing'}" for each, parent in kinds)


def reset_window(window, document, workspace):
    """Bring the window into a defined state."""
    document.open(load_sketch("valley_river"))
    workspace.selection = None
    workspace.tool = "brush"
    for layer in reversed(LAYERS):  # forms are created lazily; mountains last
        workspace.use_label(layer, 1)
    window.actions_by_name["reset-layout"].trigger()
    window.resize(1500, 920)
    window.canvas.fit()
    settle()


@pytest.mark.parametrize(
    "actions", [pytest.param(400, marks=pytest.mark.slow), pytest.param(10_000, marks=pytest.mark.soak)]
)
def test_random_actions_leave_no_widget_and_no_memory_behind(
    window, document, workspace, monkeypatch, tmp_path, actions
):
    monkeypatch.chdir(tmp_path)
    monkey = Monkey(window, document, workspace, seed=8)
    measured = counted = None
    for number in range(actions):
        monkey.act()
        if number == int(WARM * actions):
            reset_window(window, document, workspace)
            measured, counted = resident(), widgets()
    reset_window(window, document, workspace)
    grown = resident() / measured
    more = widgets() - counted
    stray = [each for each in QApplication.topLevelWidgets() if type(each) is QtWidgets.QWidget]
    details = [(each.size(), [type(child).__name__ for child in each.children()]) for each in stray]
    print(f"{actions} actions: memory {measured >> 20} MiB, {grown:.3f} times as much at the end")  # noqa: T201
    assert not more, f"widgets that stayed: {more}, {details}"
    assert grown < GROWTH
