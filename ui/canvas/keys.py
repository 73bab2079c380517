"""What keys do on the canvas."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtCore import QPointF, Qt

if TYPE_CHECKING:
    from PyQt6.QtGui import QKeyEvent

    from sketchterrain.ui.canvas.canvas import Canvas
    from sketchterrain.ui.canvas.desk import Desk
    from sketchterrain.ui.canvas.hands import Hands

__all__ = ["Keys"]

_STEP = 64.0  # logical px that an arrow key moves the sheet
_BRUSH = 1.2
_ZOOM = 1.25
_MOVES = {
    Qt.Key.Key_Left: (1, 0),
    Qt.Key.Key_Right: (-1, 0),
    Qt.Key.Key_Up: (0, 1),
    Qt.Key.Key_Down: (0, -1),
}
_BRUSHES = {Qt.Key.Key_BracketLeft: 1.0 / _BRUSH, Qt.Key.Key_BracketRight: _BRUSH}
_ZOOMS = {Qt.Key.Key_Plus: _ZOOM, Qt.Key.Key_Equal: _ZOOM, Qt.Key.Key_Minus: 1.0 / _ZOOM}


class Keys:
    """Does what keys mean on the canvas.

    Parameters
    ----------
    desk : Desk
    hands : Hands
    canvas : Canvas
    """

    def __init__(self, desk: Desk, hands: Hands, canvas: Canvas) -> None:
        self._desk = desk
        self._hands = hands
        self._canvas = canvas

    def wants(self, event: QKeyEvent) -> bool:
        """Whether a key means something here, so that no shortcut of the window has it."""
        if event.modifiers() & (Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier):
            return False
        key = event.key()
        own = (*_MOVES, *_BRUSHES, *_ZOOMS, Qt.Key.Key_Space, Qt.Key.Key_Home)
        return key in own or self._hands.tool.takes(key)

    def press(self, event: QKeyEvent) -> bool:
        """Do what a key means; return whether it means anything."""
        if not self.wants(event):
            return False
        key = event.key()
        if self._hands.tool.key(key):
            return True
        if key == Qt.Key.Key_Space:
            if not event.isAutoRepeat():
                self._hands.hold_space(True)
        elif key == Qt.Key.Key_Home:
            self._canvas.fit()
        elif key in _MOVES:
            right, down = _MOVES[Qt.Key(key)]
            self._canvas.scroll_by(right * _STEP, down * _STEP)
        elif key in _BRUSHES:
            self._desk.workspace.brush *= _BRUSHES[Qt.Key(key)]
        else:
            self._canvas.zoom(_ZOOMS[Qt.Key(key)], QPointF(self._canvas.rect().center()))
        return True

    def release(self, event: QKeyEvent) -> bool:
        """Let go of the space bar; return whether that is what was let go."""
        if event.key() != Qt.Key.Key_Space:
            return False
        if not event.isAutoRepeat():
            self._hands.hold_space(False)
        return True
