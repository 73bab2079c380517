"""Someone who does at random what the window lets them do."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from PyQt6.QtCore import QPoint, QPointF, Qt, QTimer
from PyQt6.QtGui import QWheelEvent
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

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.workspace import Workspace
    from sketchterrain.ui.window import MainWindow

_KEYS = (
    Qt.Key.Key_BracketLeft,
    Qt.Key.Key_BracketRight,
    Qt.Key.Key_Escape,
    Qt.Key.Key_Delete,
    Qt.Key.Key_Return,
    Qt.Key.Key_Left,
    Qt.Key.Key_Up,
    Qt.Key.Key_Tab,
    Qt.Key.Key_W,
    Qt.Key.Key_Space,
)
_MOVES = (Qt.Key.Key_Up, Qt.Key.Key_Down, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown, Qt.Key.Key_Home)
_BUTTONS = (Qt.MouseButton.LeftButton, Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton)
UNTRIGGERED = ("quit", "restart", "full-screen")
"""Of the actions: the program shall go on, and the engine is tested elsewhere."""


class Monkey:
    """Does one thing after another.

    Parameters
    ----------
    window, document, workspace
        What is before it.
    seed
        Another one does other things.
    """

    def __init__(self, window: MainWindow, document: Document, workspace: Workspace, *, seed: int) -> None:
        self._window, self._document, self._workspace = window, document, workspace
        self._random = random.Random(seed)
        self._sketches = [load_sketch(name) for name in preset_names()]
        self.did: list[str] = []

    def act(self) -> None:
        """Do one thing, and let the program answer."""
        deeds = (
            *(self.paint,) * 8,
            *(self.use_history,) * 4,
            *(self.turn_form,) * 4,
            *(self.trigger,) * 3,
            *(self.press,) * 2,
            *(self.scroll,) * 2,
            *(self.choose,) * 3,
            self.resize,
            self.dock,
            self.load,
            self.look_around,
        )
        deed = self._random.choice(deeds)
        self.did.append(deed.__name__)
        deed()
        QApplication.processEvents()

    def paint(self) -> None:
        """Drag over the canvas with whatever tool there is."""
        self._drag(self._window.canvas)

    def look_around(self) -> None:
        """Drag over the 3-D view."""
        self._drag(self._window.view)

    def use_history(self) -> None:
        """Undo, redo, or go somewhere."""
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
        """Press a key on the canvas or the 3-D view."""
        target = self._random.choice((self._window.canvas, self._window.view))
        QTest.keyClick(target, self._random.choice(_KEYS))

    def scroll(self) -> None:
        """Turn the wheel."""
        target = self._random.choice((self._window.canvas, self._window.view))
        place = QPointF(self._place(target))
        keys = self._random.choice((Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ShiftModifier))
        step = QPoint(0, self._random.choice((-240, -120, 120, 240)))
        no_button, no_phase = Qt.MouseButton.NoButton, Qt.ScrollPhase.NoScrollPhase
        where = QPointF(target.mapToGlobal(place.toPoint()))
        event = QWheelEvent(place, where, QPoint(), step, no_button, keys, no_phase, False)
        QApplication.sendEvent(target, event)

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
        """Give the window another size."""
        self._window.resize(self._random.randrange(720, 1700), self._random.randrange(480, 1000))

    def dock(self) -> None:
        """Close, show or float a panel."""
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

    def _drag(self, widget: QWidget) -> None:
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

    def _place(self, widget: QWidget) -> QPoint:
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
