"""The program's own icon: a range, a valley and a river, drawn at every size that desktops ask for."""

from __future__ import annotations

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QIcon, QLinearGradient, QPainter, QPainterPath, QPen, QPixmap

from sketchterrain.ui.look.icon_paths import path_of

__all__ = ["app_icon", "app_picture"]

_SIZES = (16, 24, 32, 48, 64, 128, 256)
_GRID = 32.0


def app_icon() -> QIcon:
    """Return the icon in all sizes."""
    made = QIcon()
    for size in _SIZES:
        made.addPixmap(app_picture(size))
    return made


def app_picture(size: int, dpr: float = 1.0) -> QPixmap:
    """Return the icon as a picture.

    Parameters
    ----------
    size
        Logical pixels along its side.
    dpr
        Device pixels a logical one.
    """
    picture = QPixmap(round(size * dpr), round(size * dpr))
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.scale(picture.width() / _GRID, picture.height() / _GRID)
    sheet = QPainterPath()
    sheet.addRoundedRect(QRectF(1, 1, 30, 30), 6.5, 6.5)
    painter.setClipPath(sheet)
    painter.fillPath(sheet, _fade("#f6dcae", "#9fc9d6", 1, 18))
    for drawing, upper, lower in _GROUND:
        path = path_of(drawing)
        painter.fillPath(path, _fade(upper, lower, path.boundingRect().top(), path.boundingRect().bottom()))
    pen = QPen(QColor("#d9f1f4"), 2.4, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap)
    painter.strokePath(path_of("M17.5 20.5 C22 22.5 11.5 24 14.5 27 C16 28.6 18.5 29.5 18.5 32"), pen)
    painter.end()
    picture.setDevicePixelRatio(dpr)
    return picture


_GROUND = (
    ("M1 21 L8 12 L12.5 17.5 L19 8 L26 17 L31 13.5 L31 24 L1 24 Z", "#5d7d8c", "#86a3a6"),
    ("M19 8 L22.5 12.5 L20.4 12 L18.8 13.6 L17.2 12.2 L15.6 13 Z", "#ffffff", "#eaf1f2"),
    ("M1 22.5 C7 16.5 12 18 17 20.5 C22 19 27 18.5 31 20.5 L31 31 L1 31 Z", "#3f8f6f", "#1d6158"),
    ("M1 27 C6 23.5 10 25 13 31 L1 31 Z", "#1d756b", "#12463f"),
    ("M31 25.5 C26 23 22 26 20 31 L31 31 Z", "#1d756b", "#12463f"),
)


def _fade(upper: str, lower: str, top: float, bottom: float) -> QLinearGradient:
    fade = QLinearGradient(QPointF(0, top), QPointF(0, bottom))
    fade.setColorAt(0.0, QColor(upper))
    fade.setColorAt(1.0, QColor(lower))
    return fade
