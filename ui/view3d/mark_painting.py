"""How features, rivers and handles are drawn over a picture: light with a dark rim, seen on any ground."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QFont, QFontMetricsF, QPainter, QPainterPath, QPen, QPolygonF

from sketchterrain.ui.look.theme import DARK

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sketchterrain.ui.models.handles import Handle
    from sketchterrain.ui.models.workspace import Chosen
    from sketchterrain.ui.view3d.marks import Dot, Grip, Line, Marks

__all__ = ["draw_marks", "draw_tag"]

_RIM: Final = QColor(12, 16, 20, 150)
_LIGHT: Final = QColor(255, 255, 255, 235)
_WATER: Final = QColor("#9fd4ff")
_ACCENT: Final = QColor(DARK.accent)  # pictures of ground are as dark as a dark theme
_HIDDEN = 0.28  # opacity of what ground hides
_GRIP, _DOT = 5.0, 3.2  # px, radii
_QUIET = 0.8  # opacity of what is not under the mouse


def draw_marks(painter: QPainter, marks: Marks, *, hovered: Handle | Chosen | None) -> None:
    """Draw everything.

    Parameters
    ----------
    painter
    marks
    hovered
        What is under the mouse: it is drawn larger.
    """
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    _draw_lines(painter, marks.rivers, _WATER, 1.4)
    for dot in marks.dots:
        _draw_dot(painter, dot, larger=dot.chosen == hovered)
    _draw_lines(painter, marks.outline, _ACCENT, 2.0)
    for grip in marks.grips:
        _draw_grip(painter, grip, larger=grip.handle == hovered)


def draw_tag(painter: QPainter, text: str, x: float, y: float, font: QFont, within: QRectF) -> None:
    """Write a line on a dark plate, above a place (px) and inside a rectangle."""
    metrics = QFontMetricsF(font)
    plate = QRectF(0.0, 0.0, metrics.horizontalAdvance(text) + 14.0, metrics.height() + 6.0)
    plate.moveCenter(QPointF(x, y - 0.5 * plate.height() - 12.0))
    plate.moveLeft(min(max(plate.left(), within.left() + 4.0), within.right() - plate.width() - 4.0))
    if plate.top() < within.top() + 4.0:
        plate.moveTop(y + 12.0)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(18, 21, 24, 205))
    painter.drawRoundedRect(plate, 5.0, 5.0)
    painter.setPen(_LIGHT)
    painter.setFont(font)
    painter.drawText(plate, Qt.AlignmentFlag.AlignCenter, text)


def _draw_lines(painter: QPainter, lines: Iterable[Line], colour: QColor, width: float) -> None:
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for hidden in (True, False):
        painter.setOpacity(_HIDDEN if hidden else 1.0)
        path = QPainterPath()
        for line in lines:
            _add_pieces(path, line, hidden=hidden)
        for pen_colour, pen_width in ((_RIM, width + 2.2), (colour, width)):
            pen = QPen(pen_colour, pen_width)
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
            painter.setPen(pen)
            painter.drawPath(path)
    painter.setOpacity(1.0)


def _add_pieces(path: QPainterPath, line: Line, *, hidden: bool) -> None:
    last = None
    for (x, y, to_x, to_y), off in zip(line.pieces.tolist(), line.hidden.tolist(), strict=True):
        if off == hidden:
            if last != (x, y):
                path.moveTo(x, y)
            path.lineTo(to_x, to_y)
            last = to_x, to_y


def _draw_dot(painter: QPainter, dot: Dot, *, larger: bool) -> None:
    painter.setOpacity(_HIDDEN if dot.hidden else 1.0 if larger else _QUIET)
    painter.setPen(QPen(_RIM, 1.4))
    painter.setBrush(_ACCENT if larger else _LIGHT)
    shape = _shape(dot.kind, _DOT * (1.7 if larger else 1.0))
    painter.drawPath(shape.translated(dot.x, dot.y))
    painter.setOpacity(1.0)


def _shape(kind: str, size: float) -> QPainterPath:
    """Return the mark of a type around the origin: told apart without colour."""
    path = QPainterPath()
    if kind == "mountain":
        corners = [
            QPointF(0.0, -1.3 * size),
            QPointF(1.25 * size, 0.9 * size),
            QPointF(-1.25 * size, 0.9 * size),
        ]
        path.addPolygon(QPolygonF(corners))
        path.closeSubpath()
    elif kind == "hill":
        path.moveTo(-1.3 * size, 0.8 * size)
        path.arcTo(QRectF(-1.3 * size, -1.0 * size, 2.6 * size, 3.6 * size), 180.0, -180.0)
        path.closeSubpath()
    elif kind == "dune":
        path.moveTo(-1.4 * size, 0.8 * size)
        path.quadTo(0.3 * size, 0.6 * size, 0.5 * size, -1.0 * size)
        path.quadTo(0.7 * size, 0.5 * size, 1.4 * size, 0.8 * size)
        path.closeSubpath()
    else:
        path.addEllipse(QPointF(0.0, 0.0), size, size)
    return path


def _draw_grip(painter: QPainter, grip: Grip, *, larger: bool) -> None:
    painter.setOpacity(_HIDDEN + 0.2 if grip.hidden else 1.0)
    at = QPointF(grip.x, grip.y)
    size = _GRIP * (1.4 if larger else 1.0)
    if grip.handle.role in ("radius", "width"):
        for colour, width in ((_RIM, 3.2), (_ACCENT, 1.2)):
            painter.setPen(QPen(colour, width))
            painter.drawLine(QPointF(grip.base_x, grip.base_y), at)
    painter.setPen(QPen(_RIM, 2.0))
    painter.setBrush(_ACCENT if larger else _LIGHT)
    if grip.handle.role == "point":
        painter.drawEllipse(at, 0.8 * size, 0.8 * size)
    elif grip.handle.role == "move":
        painter.drawEllipse(at, 1.2 * size, 1.2 * size)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(_LIGHT if larger else _ACCENT)
        painter.drawEllipse(at, 0.55 * size, 0.55 * size)
    else:
        painter.drawRoundedRect(QRectF(grip.x - size, grip.y - size, 2.0 * size, 2.0 * size), 2.0, 2.0)
    painter.setOpacity(1.0)
