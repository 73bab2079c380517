"""Someone who does at random what the window lets them do."""

from __future__ import annotations

import random

from PyQt6.QtCore import QPoint, Qt, QTimer
from PyQt6.QtTest import QTest
from PyQt6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QDockWidget,
    QMenu,
)

from sketchterrain.resources import preset_names
from sketchterrain.sketch import LAYERS, load_sketch
from sketchterrain.ui.models.workspace import OVERLAYS, TOOLS

from .events import wheel

_NAMES = "BracketLeft BracketRight Escape Delete Return Left Up Tab W Space"
_KEYS = [getattr(Qt.Key, f"Key_{name}") for name in _NAMES.split()]
_MOVES = [getattr(Qt.Key, f"Key_{name}") for name in ["Up", "Down", "PageUp", "PageDown", "Home"]]
_BUTTONS = (Qt.MouseButton.LeftButton, Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton)
UNTRIGGERED = ("quit", "restart", "full-screen")
"""Of the actions: the program shall go on, and the engine is tested elsewhere."""


class Monkey:
    """Does one thing after another; another seed does other things."""

    def __init__(self, window, document, workspace, *, seed: int) -> None:
        self._window, self._document, self._workspace = window, document, workspace
        self._random = random.Random(seed)
        self._sketches = [load_sketch(name) for name in preset_names()]
        self.did: list[str] = []

    def act(self) -> None:
        """Do one thing, and let the program answer."""
        often = {self.paint: 8, self.use_history: 4, self.turn_form: 4, self.trigger: 3, self.choose: 3}
        often |= {self.press: 2, self.scroll: 2}
        often |= dict.fromkeys((self.resize, self.dock, self.load, self.look_around), 1)
        (deed,) = self._random.choices([*often], [*often.values()])
        self.did.append(deed.__name__)
        deed()
        QApplication.processEvents()

    def paint(self) -> None:
        self._drag(self._window.canvas)

    def look_around(self) -> None:
        self._drag(self._window.view)

    def use_history(self) -> None:
        what = self._random.choice(("undo", "redo", "go"))
        if what == "go":
            self._document.go_to(self._random.randrange(len(self._document.history.titles)))
        else:
            self._window.actions_by_name[what].trigger()

    def trigger(self) -> None:
        """Do something of the menus; dialogs are closed as they come."""
        actions = [each for each in self._window.actions_by_name if each.objectName() not in UNTRIGGERED]
        action = self._random.choice(actions)
        self.did[-1] += f" {action.objectName()}"
        if action.isEnabled():
            closing = DialogCloser()
            action.trigger()
            QApplication.processEvents()
            closing.stop()

    def turn_form(self) -> None:
        """Press a key on one of the controls of the panels."""
        kinds = (QAbstractSlider, QAbstractSpinBox, QComboBox, QAbstractItemView)
        controls = [each for kind in kinds for each in self._window.findChildren(kind) if each.isVisible()]
        buttons = [
            each
            for dock in self._window.findChildren(QDockWidget)
            for each in dock.findChildren(QAbstractButton)
            if each.isVisible() and each.isEnabled()
        ]
        control = self._random.choice([*controls, *buttons])
        self.did[-1] += f" {type(control).__name__} {control.accessibleName()}"
        closing = DialogCloser()
        if isinstance(control, QAbstractButton):
            QTest.mouseClick(control, Qt.MouseButton.LeftButton)
        else:
            for _ in range(self._random.randrange(1, 4)):
                QTest.keyClick(control, self._random.choice(_MOVES))
        QApplication.processEvents()
        closing.stop()

    def press(self) -> None:
        target = self._random.choice((self._window.canvas, self._window.view))
        QTest.keyClick(target, self._random.choice(_KEYS))

    def scroll(self) -> None:
        target = self._random.choice((self._window.canvas, self._window.view))
        place = self._place(target)
        keys = self._random.choice((Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ShiftModifier))
        wheel(target, place.x(), place.y(), self._random.choice((-2, -1, 1, 2)), keys)

    def choose(self) -> None:
        """Take another tool, label, brush or overlay, or hide or lock a layer."""
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

    def resize(self) -> None:
        self._window.resize(self._random.randrange(720, 1700), self._random.randrange(480, 1000))

    def dock(self) -> None:
        dock = self._random.choice(self._window.findChildren(QDockWidget))
        what = self._random.randrange(3)
        if what == 2:
            dock.setFloating(not dock.isFloating())
        else:
            dock.setVisible(what == 1)

    def load(self) -> None:
        """Open another sketch; one in four times, for it takes its time."""
        if self._random.random() < 0.25:
            self._document.open(self._random.choice(self._sketches))

    def _drag(self, widget) -> None:
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
    """Closes whatever waits for an answer, as long as it is not stopped."""

    def __init__(self) -> None:
        self._timer = QTimer()
        self._timer.timeout.connect(self._close)
        self._timer.start(0)

    def stop(self) -> None:
        self._close()
        self._timer.stop()

    @staticmethod
    def _close() -> None:
        for widget in (QApplication.activePopupWidget(), QApplication.activeModalWidget()):
            if widget is not None:
                widget.close()
        for menu in QApplication.topLevelWidgets():
            if isinstance(menu, (QMenu, QDialog)) and menu.isVisible():
                menu.close()
