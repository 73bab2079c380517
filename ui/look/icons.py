"""Icons drawn by the program: sharp at any size, in the colours of the palette, dark or light."""

from __future__ import annotations

from functools import cache

from PyQt6.QtCore import QPoint, QRect, QRectF, QSize, Qt
from PyQt6.QtGui import QColor, QIcon, QIconEngine, QPainter, QPainterPath, QPalette, QPen, QPixmap
from PyQt6.QtWidgets import QApplication

from sketchterrain.ui.look.icon_paths import path_of
from sketchterrain.ui.look.icon_shapes import GRID, ICONS

__all__ = ["draw_icon", "icon"]

_WIDTH = 1.5  # of a line, on the grid
_SHADE = 0.28  # opacity of an area
_DOT = 3.3  # the widest dot


def icon(name: str) -> QIcon:
    """Return an icon of `ICONS`.

    It is drawn when it is shown: in the text's colour as the palette has it then.

    Raises
    ------
    KeyError
        If there is none of that name.
    """
    _paths(name)
    return QIcon(_Engine(name))


def draw_icon(painter: QPainter, name: str, place: QRectF, colour: QColor) -> None:
    """Draw an icon into a square in one colour.

    Raises
    ------
    KeyError
        If there is none of that name.
    """
    line, fill = _paths(name)
    side = min(place.width(), place.height())
    painter.save()
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.translate(place.center().x() - side / 2, place.center().y() - side / 2)
    painter.scale(side / GRID, side / GRID)
    opacity = painter.opacity()
    painter.setOpacity(opacity * (_SHADE if _is_area(fill) else 1.0))
    painter.fillPath(fill, colour)
    painter.setOpacity(opacity)
    pen = QPen(colour, _WIDTH, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin)
    painter.strokePath(line, pen)
    painter.restore()


@cache
def _paths(name: str) -> tuple[QPainterPath, QPainterPath]:
    shape = ICONS[name]
    return path_of(shape.line), path_of(shape.fill)


def _is_area(fill: QPainterPath) -> bool:
    # Dots stand for themselves; an area, whose outline is drawn too, is only tinted.
    return any(polygon.boundingRect().width() > _DOT for polygon in fill.toSubpathPolygons())


class _Engine(QIconEngine):
    """Draws one icon in the state that a control is in."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name

    def clone(self) -> QIconEngine:
        return _Engine(self._name)

    def key(self) -> str:
        return f"sketchterrain-{self._name}"

    def isNull(self) -> bool:
        return False

    def actualSize(self, size: QSize, mode: QIcon.Mode, state: QIcon.State) -> QSize:
        return size

    def paint(self, painter: QPainter | None, rect: QRect, mode: QIcon.Mode, state: QIcon.State) -> None:
        if painter is not None:
            draw_icon(painter, self._name, QRectF(rect), _colour(mode, state))

    def pixmap(self, size: QSize, mode: QIcon.Mode, state: QIcon.State) -> QPixmap:
        picture = QPixmap(size)
        picture.fill(Qt.GlobalColor.transparent)
        painter = QPainter(picture)
        self.paint(painter, QRect(QPoint(0, 0), size), mode, state)
        painter.end()
        return picture


def _colour(mode: QIcon.Mode, state: QIcon.State) -> QColor:
    palette = QApplication.palette()
    if mode == QIcon.Mode.Disabled:
        return palette.color(QPalette.ColorGroup.Disabled, QPalette.ColorRole.ButtonText)
    if mode == QIcon.Mode.Selected or state == QIcon.State.On:
        return palette.color(QPalette.ColorRole.HighlightedText)
    return palette.color(QPalette.ColorRole.ButtonText)
