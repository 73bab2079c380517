"""Mouse, wheel, pen and key events sent to a widget, strokes, mnemonics, and waiting."""

import threading
import time

from PyQt6 import QtGui
from PyQt6.QtCore import QEvent, QEventLoop, QPoint, QPointF, Qt
from PyQt6.QtGui import (
    QInputDevice,
    QKeyEvent,
    QKeySequence,
    QMouseEvent,
    QPointingDevice,
    QTabletEvent,
    QWheelEvent,
)
from PyQt6.QtWidgets import QApplication

from sketchterrain.ui.models.document import Draft

LEFT, RIGHT, MIDDLE = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton, Qt.MouseButton.MiddleButton
NO_BUTTON, NO_KEYS = Qt.MouseButton.NoButton, Qt.KeyboardModifier.NoModifier
PRESS, RELEASE = QEvent.Type.MouseButtonPress, QEvent.Type.MouseButtonRelease
MOVE, DOUBLE = QEvent.Type.MouseMove, QEvent.Type.MouseButtonDblClick


def mouse(widget, kind: QEvent.Type, x: float, y: float, button=LEFT, modifiers=NO_KEYS) -> None:
    at, held = QPointF(x, y), NO_BUTTON if kind == RELEASE else button
    changed = NO_BUTTON if kind == MOVE else button
    QApplication.sendEvent(widget, QMouseEvent(kind, at, widget.mapToGlobal(at), changed, held, modifiers))


def drag(widget, start, *places, button=LEFT, modifiers=NO_KEYS) -> None:
    mouse(widget, PRESS, *start, button, modifiers)
    for place in places:
        mouse(widget, MOVE, *place, button, modifiers)
    mouse(widget, RELEASE, *(places or [start])[-1], button, modifiers)


def click(widget, x: float, y: float, button=LEFT, modifiers=NO_KEYS) -> None:
    drag(widget, (x, y), button=button, modifiers=modifiers)


def wheel(widget, x: float, y: float, notches: float, modifiers=NO_KEYS) -> None:
    at, turn = QPointF(x, y), QPoint(0, round(120 * notches))
    phase = Qt.ScrollPhase.NoScrollPhase
    event = QWheelEvent(at, widget.mapToGlobal(at), QPoint(), turn, NO_BUTTON, modifiers, phase, False)
    QApplication.sendEvent(widget, event)


def key(widget, code: Qt.Key, *, up=False, repeat=False, modifiers=NO_KEYS) -> None:
    kind = QEvent.Type.KeyRelease if up else QEvent.Type.KeyPress
    QApplication.sendEvent(widget, QKeyEvent(kind, code, modifiers, "", repeat))


def overrides(widget, code: Qt.Key, modifiers=NO_KEYS) -> bool:
    """Return whether a widget overrides a shortcut of its window."""
    event = QKeyEvent(QEvent.Type.ShortcutOverride, code, modifiers)
    event.ignore()
    QApplication.sendEvent(widget, event)
    return event.isAccepted()


def pen(widget, kind: QEvent.Type, x: float, y: float, pressure: float, *, erases=False) -> bool:
    """Send a pen's event; return whether it was accepted."""
    tip = QPointingDevice.PointerType.Eraser if erases else QPointingDevice.PointerType.Pen
    stylus, feels = QInputDevice.DeviceType.Stylus, QInputDevice.Capability.Pressure
    device = QPointingDevice("pen", 1, stylus, tip, feels, 1, 2, "", QtGui.QPointingDeviceUniqueId())
    at, held = QPointF(x, y), NO_BUTTON if kind == QEvent.Type.TabletRelease else LEFT
    where, tilt = widget.mapToGlobal(at), [0.0] * 5
    event = QTabletEvent(kind, device, at, where, pressure, *tilt, NO_KEYS, LEFT, held)
    QApplication.sendEvent(widget, event)
    return event.isAccepted()


def paint(document, layer: str, box: tuple, label: int = 1, *, title: str | None = "Paint") -> Draft:
    """Paint a box (top, left, bottom, right) and commit the draft if it has a title."""
    draft = document.begin_draft(layer)
    top, left, bottom, right = box
    draft.image[top:bottom, left:right] = label
    draft.touch(box)
    if title:
        draft.commit(title)
    return draft


def repeated_mnemonics(items) -> set[str]:
    """Return the mnemonics that several visible widgets or actions share."""
    letters = [QKeySequence.mnemonic(each.text()).toString() for each in items if each.isVisible()]
    return {letter for letter in letters if letter and letters.count(letter) > 1}


def finish_reading():
    """Wait until background readers have ended and their results have arrived."""
    for thread in threading.enumerate():
        if thread.name == "reading":
            thread.join()
    QApplication.processEvents()


def wait(until, seconds=300.0):
    """Process events until a condition holds; generous, since machines are shared."""
    end = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < end, "condition not met in time"
        QApplication.processEvents(QEventLoop.ProcessEventsFlag.WaitForMoreEvents, 20)
        time.sleep(0.002)
