"""Icons as SVG files, recoloured by the palette and rendered at the screen's own pixels."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from PyQt6.QtCore import QByteArray, QPoint, QRect, QRectF, QSize, Qt
from PyQt6.QtGui import QColor, QIcon, QIconEngine, QPainter, QPalette, QPixmap
from PyQt6.QtSvg import QSvgRenderer
from PyQt6.QtWidgets import QApplication, QToolButton, QWidget

ICONS = Path(__file__).with_name("icons")
MARKS = Path(__file__).with_name("marks")
_APP_SIZES = (16, 24, 32, 48, 64, 128, 256)


def icon(name: str) -> QIcon:
    """Return an icon by the name of its file, in the text's colour of the palette at the time it is shown."""
    _svg(name, "")
    return QIcon(_Engine(name))


def app_icon() -> QIcon:
    """Return the program's own icon in all sizes that desktops ask for."""
    made = QIcon()
    for size in _APP_SIZES:
        made.addPixmap(app_picture(size))
    return made


def app_picture(size: int, dpr: float = 1.0) -> QPixmap:
    """Return the program's icon, `size` logical pixels wide, `dpr` device pixels each."""
    picture = QPixmap(round(size * dpr), round(size * dpr))
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    draw_icon(painter, "sketchterrain", picture.rect().toRectF(), QColor())
    painter.end()
    picture.setDevicePixelRatio(dpr)
    return picture


def draw_icon(painter: QPainter, name: str, place: QRectF, colour: QColor) -> None:
    """Draw an icon into the largest square at the middle of `place`."""
    side = min(place.width(), place.height())
    square = QRectF(0, 0, side, side)
    square.moveCenter(place.center())
    painter.save()
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setOpacity(painter.opacity() * colour.alphaF())
    QSvgRenderer(_svg(name, colour.name())).render(painter, square)
    painter.restore()


def tool_button(
    name: str, title: str, *, tip: str = "", side: int = 18, parent: QWidget | None = None
) -> QToolButton:
    """Return a button of an icon alone; its title is its accessible name, and its tip unless one is given."""
    button = QToolButton(parent)
    button.setIcon(icon(name))
    button.setIconSize(QSize(side, side))
    button.setAccessibleName(title)
    button.setToolTip(tip or title)
    return button


@lru_cache(maxsize=512)
def _svg(name: str, colour: str) -> QByteArray:
    """Return an icon's SVG in a colour; a renderer is a QObject, which would end with its application."""
    text = (ICONS / f"{name}.svg").read_bytes()
    return QByteArray(text.replace(b"currentColor", colour.encode()))


class _Engine(QIconEngine):
    """Draws one icon in the state of its control."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name

    def clone(self) -> QIconEngine:
        return _Engine(self._name)

    def isNull(self) -> bool:
        return False

    def actualSize(self, size: QSize, mode: QIcon.Mode, state: QIcon.State) -> QSize:
        return size

    def paint(self, painter: QPainter | None, rect: QRect, mode: QIcon.Mode, state: QIcon.State) -> None:
        palette, role = QApplication.palette(), QPalette.ColorRole
        group = QPalette.ColorGroup.Disabled if mode == QIcon.Mode.Disabled else QPalette.ColorGroup.Active
        lit = mode == QIcon.Mode.Selected or (state == QIcon.State.On and mode != QIcon.Mode.Disabled)
        if painter is not None:
            colour = palette.color(group, role.HighlightedText if lit else role.ButtonText)
            draw_icon(painter, self._name, QRectF(rect), colour)

    def pixmap(self, size: QSize, mode: QIcon.Mode, state: QIcon.State) -> QPixmap:
        picture = QPixmap(size)
        picture.fill(Qt.GlobalColor.transparent)
        painter = QPainter(picture)
        self.paint(painter, QRect(QPoint(0, 0), size), mode, state)
        painter.end()
        return picture
