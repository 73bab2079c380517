"""What the canvas tells of the place under the mouse when it rests there: what was decided at a warning."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtCore import QEvent, QObject, QPointF
from PyQt6.QtGui import QHelpEvent
from PyQt6.QtWidgets import QToolTip

from sketchterrain.ui.canvas import furniture

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.canvas.desk import Desk

__all__ = ["Tips"]


class Tips(QObject):
    """Shows tool tips on a canvas.

    Parameters
    ----------
    desk
    canvas
    """

    def __init__(self, desk: Desk, canvas: QWidget) -> None:
        super().__init__(canvas)
        self._desk, self._canvas = desk, canvas
        canvas.installEventFilter(self)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        """Show a tip where there is something to tell, and take it away elsewhere."""
        if not isinstance(event, QHelpEvent) or event.type() != QEvent.Type.ToolTip:
            return False
        text = ""
        if "contradictions" in self._desk.workspace.overlays:
            text = furniture.warning_at(self._desk, QPointF(event.pos()))
        QToolTip.showText(event.globalPos(), text, self._canvas)
        return True
