"""What lies over the sketch, as the workspace says: what was placed, warnings, the eye, the scale."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtCore import QRect, QRectF
from PyQt6.QtGui import QPainter

from sketchterrain.ui.canvas import furniture

if TYPE_CHECKING:
    from sketchterrain.ui.canvas.desk import Desk
    from sketchterrain.ui.canvas.marks import Marks
    from sketchterrain.ui.canvas.tool import Tool
    from sketchterrain.ui.engine.messages import FrameFacts
    from sketchterrain.ui.engine.orders import Pose

__all__ = ["Overlays"]


class Overlays:
    """Draws what lies over the sketch.

    Parameters
    ----------
    desk : Desk
    marks : Marks
    """

    def __init__(self, desk: Desk, marks: Marks) -> None:
        self._desk = desk
        self._marks = marks
        self._eye: Pose | None = None

    def forget_eye(self) -> None:
        """Forget where the eye was drawn: all is drawn anew."""
        self._eye = None

    def eye_moved(self, facts: FrameFacts) -> tuple[QRectF, ...]:
        """Return the rectangles (logical px) of the canvas in which the eye is not as it was."""
        before, pose = self._eye, facts.pose
        if pose == before or "eye" not in self._desk.workspace.overlays:
            return ()
        self._eye = pose
        return tuple(furniture.eye_area(self._desk, each) for each in (before, pose) if each is not None)

    def draw(self, painter: QPainter, area: QRect, tool: Tool, width: float, height: float) -> None:
        """Draw into an area (logical px) of a canvas of a size."""
        desk, shown, placed = self._desk, self._desk.workspace.overlays, self._desk.link.placed
        if placed is not None and "features" in shown:
            image, ratio = self._marks.image(placed), desk.ratio
            source = QRectF(area.x() * ratio, area.y() * ratio, area.width() * ratio, area.height() * ratio)
            painter.drawImage(QRectF(area), image, source)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if "contradictions" in shown:
            furniture.draw_warnings(painter, desk)
        if "eye" in shown and desk.link.frame is not None:
            furniture.draw_eye(painter, desk, desk.link.frame.pose)
        tool.draw(painter)
        furniture.draw_scale_bar(painter, desk, height)
        if "adherence" in shown:
            furniture.draw_agreement(painter, desk, width)
