"""Brush and eraser: strokes on a layer, and the ring that shows the brush's size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QPen

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.canvas.tool import Tool
from sketchterrain.ui.painting.stroke import Stroke

if TYPE_CHECKING:
    from PyQt6.QtGui import QPainter

    from sketchterrain.ui.canvas.desk import Desk, Pointer
    from sketchterrain.ui.models.document import Draft

__all__ = ["BrushTool"]

_LEAST_PRESSURE = 0.2  # share of the radius that the lightest touch has


class BrushTool(Tool):
    """Paints strokes with the label that one paints with, or erases.

    Parameters
    ----------
    desk : Desk
    erases
        Whether it always erases.
    """

    cursor = Qt.CursorShape.CrossCursor

    def __init__(self, desk: Desk, *, erases: bool = False) -> None:
        super().__init__(desk)
        self._always_erases = erases
        self._draft: Draft | None = None
        self._stroke: Stroke | None = None
        self._title = ""
        self._place: tuple[float, float] | None = None
        self._radius = 0.0

    @property
    def is_busy(self) -> bool:
        """Whether a stroke is being drawn."""
        return self._draft is not None

    def press(self, pointer: Pointer) -> None:
        """Begin a stroke."""
        self._follow(pointer)
        if self._draft is not None or not self.desk.may_paint():
            return
        workspace = self.desk.workspace
        erases = self._always_erases or pointer.erases
        verb = "Erase" if erases else "Paint"
        self._title = f"{verb} {LAYERS[workspace.layer].title.lower()}"
        self._draft = self.desk.document.begin_draft(workspace.layer)
        grain = 1.0 / max(self.desk.scale, 1e-6)
        self._stroke = Stroke(self._draft.image, 0 if erases else workspace.label, grain=grain)
        self._extend(pointer)

    def move(self, pointer: Pointer) -> None:
        """Go on with it; show the ring where the mouse is."""
        self._follow(pointer)
        self._extend(pointer)

    def release(self, pointer: Pointer) -> None:
        """End it."""
        self._extend(pointer)
        self.finish()

    def key(self, key: int) -> bool:
        """Cancel the stroke by Escape."""
        if not self.takes(key):
            return False
        self.cancel()
        return True

    def takes(self, key: int) -> bool:
        """Take Escape while a stroke is being drawn."""
        return self.is_busy and key == Qt.Key.Key_Escape

    def finish(self) -> None:
        """Make the stroke a step of the history."""
        draft, stroke = self._draft, self._stroke
        self._draft = self._stroke = None
        if draft is None or stroke is None or draft is not self.desk.document.draft:
            return
        box = stroke.finish()
        if box is not None:
            draft.touch(box)
        draft.commit(self._title)

    def cancel(self) -> None:
        """Forget the stroke."""
        draft = self._draft
        self._draft = self._stroke = None
        if draft is not None and draft is self.desk.document.draft:
            draft.cancel()

    def leave(self) -> None:
        """Show the ring no longer."""
        self.desk.tells.redraw(self.extent())
        self._place = None

    def extent(self) -> QRectF:
        """Return the rectangle around the ring."""
        if self._place is None:
            return QRectF()
        reach = self._radius * self.desk.scale + 3.0
        middle = self.desk.at(*self._place)
        return QRectF(middle.x() - reach, middle.y() - reach, 2.0 * reach, 2.0 * reach)

    def draw(self, painter: QPainter) -> None:
        """Draw the ring in the brush's size."""
        if self._place is None:
            return
        middle, reach = self.desk.at(*self._place), max(self._radius * self.desk.scale, 1.0)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for colour, width in ((QColor(255, 255, 255, 190), 3.0), (QColor(20, 20, 20, 220), 1.2)):
            painter.setPen(QPen(colour, width))
            painter.drawEllipse(middle, reach, reach)

    def show_size(self, place: QPointF | None) -> None:
        """Show the ring in the brush's size, where the mouse is."""
        self.desk.tells.redraw(self.extent())
        if place is not None:
            self._place = self.desk.on_sketch(place)
        self._radius = self.desk.workspace.brush
        self.desk.tells.redraw(self.extent())

    def _follow(self, pointer: Pointer) -> None:
        self.desk.tells.redraw(self.extent())
        self._place = (pointer.x, pointer.y)
        self._radius = self._pressed(pointer)
        self.desk.tells.redraw(self.extent())

    def _pressed(self, pointer: Pointer) -> float:
        return self.desk.workspace.brush * (_LEAST_PRESSURE + (1.0 - _LEAST_PRESSURE) * pointer.pressure)

    def _extend(self, pointer: Pointer) -> None:
        if self._draft is None or self._stroke is None:
            return
        if self._draft is not self.desk.document.draft:  # an undo, or another document, took it away
            self._draft = self._stroke = None
            return
        box = self._stroke.to(pointer.x, pointer.y, self._pressed(pointer))
        if box is not None:
            self._draft.touch(box)
