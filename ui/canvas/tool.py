"""What a tool of the canvas does with the mouse, the pen and keys."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtCore import QPointF, QRectF, Qt

if TYPE_CHECKING:
    from PyQt6.QtGui import QPainter

    from sketchterrain.ui.canvas.desk import Desk, Pointer

__all__ = ["Tool"]


class Tool:
    """A tool that does nothing; others say what they do.

    Parameters
    ----------
    desk : Desk
    """

    cursor = Qt.CursorShape.ArrowCursor

    def __init__(self, desk: Desk) -> None:
        self.desk = desk

    @property
    def is_busy(self) -> bool:
        """Whether something was begun that can be finished or cancelled."""
        return False

    def press(self, pointer: Pointer) -> None:
        """Begin: a button is pressed, or the pen touches."""

    def move(self, pointer: Pointer) -> None:
        """Go on: the mouse moves, with or without a button."""

    def release(self, pointer: Pointer) -> None:
        """Let go."""

    def double(self, pointer: Pointer) -> None:
        """Do what a double click means: a second press."""
        self.press(pointer)

    def key(self, key: int) -> bool:
        """Take a key (`Qt.Key`); return whether it meant something."""
        return False

    def takes(self, key: int) -> bool:
        """Whether `key` would take a key now, so that no shortcut has it."""
        return False

    def finish(self) -> None:
        """Come to an end with what was begun: the focus is lost, or another tool is chosen."""

    def cancel(self) -> None:
        """Forget what was begun."""

    def leave(self) -> None:
        """Forget where the mouse was: it left the canvas."""

    def draw(self, painter: QPainter) -> None:
        """Draw what the tool shows over the sketch, in logical pixels."""

    def cursor_at(self, place: QPointF) -> Qt.CursorShape:
        """Return the shape of the mouse's cursor at a place of the screen."""
        return self.cursor

    def extent(self) -> QRectF:
        """Return the rectangle (logical px) outside of which `draw` draws nothing; empty: all of it."""
        return QRectF()
