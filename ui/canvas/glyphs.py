"""Small signs of what was placed: one a type of feature, readable on light and dark paint."""

from __future__ import annotations

import math
from functools import cache, lru_cache

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QImage, QPainter, QPainterPath, QPen, QPolygonF

__all__ = ["CHOSEN", "DARK", "LIGHT", "draw_glyph", "draw_haloed", "stamp_glyph"]

LIGHT = QColor(255, 255, 255, 205)
"""Around lines."""
DARK = QColor(24, 26, 30)
"""Lines."""
CHOSEN = QColor(112, 38, 200)
"""What is chosen: a hue that no layer has, as dark on paper in either theme."""


def draw_glyph(
    painter: QPainter, kind: str, at: QPointF, *, colour: QColor = DARK, size: float = 1.0
) -> None:
    """Draw the sign of a type of feature around a place.

    Parameters
    ----------
    painter
    kind : {'mountain', 'hill', 'dune', 'forest'}
    at : QPointF
        Its middle, logical px.
    colour : QColor
        Of its lines.
    size : float
        1 is about 11 px.
    """
    painter.save()
    painter.translate(at)
    painter.scale(size, size)
    draw_haloed(painter, _glyph(kind), colour, 1.5, fill=kind in ("mountain", "forest"))
    painter.restore()


def stamp_glyph(painter: QPainter, kind: str, at: QPointF, *, alpha: int, size: float, ratio: float) -> None:
    """Draw the sign of a type of feature as `draw_glyph` does, from a picture that is kept.

    Parameters
    ----------
    painter
        On logical pixels.
    kind, at
        As for `draw_glyph`; it is put on whole device pixels.
    alpha
        0 … 255, of its lines.
    size
    ratio
        Device pixels a logical one.
    """
    picture = _picture(kind, alpha, round(size, 2), ratio)
    half = 0.5 * picture.width()
    x, y = round(at.x() * ratio - half), round(at.y() * ratio - half)
    painter.drawImage(QPointF(x / ratio, y / ratio), picture)


@lru_cache(maxsize=64)
def _picture(kind: str, alpha: int, size: float, ratio: float) -> QImage:
    side = 2 * math.ceil(9.0 * size * ratio)
    picture = QImage(side, side, QImage.Format.Format_ARGB32_Premultiplied)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    colour = QColor(DARK)
    colour.setAlpha(alpha)
    draw_glyph(painter, kind, QPointF(0.5 * side, 0.5 * side), colour=colour, size=size * ratio)
    painter.end()
    picture.setDevicePixelRatio(ratio)
    return picture


def draw_haloed(
    painter: QPainter, path: QPainterPath, colour: QColor, width: float, *, fill: bool = False
) -> None:
    """Draw a path in a colour, with a light border around it."""
    join, cap = Qt.PenJoinStyle.RoundJoin, Qt.PenCapStyle.RoundCap
    halo = QColor(LIGHT)
    halo.setAlphaF(LIGHT.alphaF() * colour.alphaF())
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.setPen(QPen(halo, width + 2.2, Qt.PenStyle.SolidLine, cap, join))
    painter.drawPath(path)
    painter.setPen(QPen(colour, width, Qt.PenStyle.SolidLine, cap, join))
    if fill:
        painter.setBrush(colour)
    painter.drawPath(path)


@cache
def _glyph(kind: str) -> QPainterPath:
    path = QPainterPath()
    if kind == "mountain":
        path.addPolygon(QPolygonF([QPointF(-5.0, 4.0), QPointF(0.0, -5.0), QPointF(5.0, 4.0)]))
        path.closeSubpath()
    elif kind == "hill":
        path.moveTo(-5.5, 3.0)
        path.cubicTo(-3.5, -5.0, 3.5, -5.0, 5.5, 3.0)
    elif kind == "dune":
        path.moveTo(-6.0, 2.5)
        path.cubicTo(-3.0, 1.5, -1.5, -1.0, 0.5, -3.5)
        path.cubicTo(0.5, -0.5, 2.5, 2.0, 6.0, 2.5)
    else:
        path.addEllipse(QRectF(-3.2, -5.5, 6.4, 6.4))
        path.moveTo(0.0, 1.0)
        path.lineTo(0.0, 5.0)
    return path
