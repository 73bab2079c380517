"""Icons as SVG files, recoloured by the palette and rendered at device pixels; rounded pictures."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from PyQt6.QtCore import QByteArray, QPoint, QRect, QRectF, QSize, Qt
from PyQt6.QtGui import (
    QColor,
    QIcon,
    QIconEngine,
    QImage,
    QPainter,
    QPainterPath,
    QPaintEvent,
    QPalette,
    QPixmap,
)
from PyQt6.QtSvg import QSvgRenderer
from PyQt6.QtWidgets import QApplication, QToolButton, QWidget

ICONS = Path(__file__).with_name("icons")
MARKS = Path(__file__).with_name("marks")
_APP_SIZES = (16, 24, 32, 48, 64, 128, 256)
_CORNER = 6.0  # px, radius of rounded corners


def icon(name: str) -> QIcon:
    """Return an icon by its file name, drawn in the current palette's text colour."""
    _svg(name, "")
    return QIcon(_Engine(name))


def app_icon() -> QIcon:
    """Return the application icon in all usual sizes."""
    application = QIcon()
    for size in _APP_SIZES:
        application.addPixmap(app_picture(size))
    return application


def app_picture(size: int, dpr: float = 1.0) -> QPixmap:
    """Return the application icon, `size` logical pixels wide, at a device pixel ratio."""
    picture = QPixmap(round(size * dpr), round(size * dpr))
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    draw_icon(painter, "sketchterrain", picture.rect().toRectF(), QColor())
    painter.end()
    picture.setDevicePixelRatio(dpr)
    return picture


def draw_icon(painter: QPainter, name: str, place: QRectF, colour: QColor) -> None:
    """Draw an icon into the largest centred square of `place`."""
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
    """Return an icon button; `title` is its accessible name, and its tool tip unless `tip` is given."""
    button = QToolButton(parent)
    button.setIcon(icon(name))
    button.setIconSize(QSize(side, side))
    button.setAccessibleName(title)
    button.setToolTip(tip or title)
    return button


class Symbol(QWidget):
    """An icon in a colour; empty without a name."""

    def __init__(self, side: int) -> None:
        super().__init__()
        self._name, self._colour = "", QColor()
        self.setFixedSize(side, side)

    def show_icon(self, name: str, colour: QColor) -> None:
        """Show another icon."""
        self._name, self._colour = name, colour
        self.update()

    def paintEvent(self, event: QPaintEvent | None) -> None:
        if self._name:
            painter = QPainter(self)
            draw_icon(painter, self._name, self.rect().toRectF(), self._colour)
            painter.end()


def rounded_picture(image: QImage, size: QSize, dpr: float) -> QPixmap:
    """Return an image that fills `size` logical pixels, with rounded corners."""
    pixels = size * dpr
    picture = QPixmap(pixels)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    outline = QPainterPath()
    outline.addRoundedRect(picture.rect().toRectF(), _CORNER * dpr, _CORNER * dpr)
    painter.setClipPath(outline)
    if image.isNull():
        painter.fillPath(outline, Qt.GlobalColor.darkGray)
    else:
        painter.drawImage(0, 0, filling(image, pixels))
    painter.end()
    picture.setDevicePixelRatio(dpr)
    return picture


def filling(image: QImage, size: QSize) -> QImage:
    """Return the middle of an image scaled to fill a size (px)."""
    cover = Qt.AspectRatioMode.KeepAspectRatioByExpanding
    scaled = image.scaled(size, cover, Qt.TransformationMode.SmoothTransformation)
    frame = QRect(QPoint(0, 0), size)
    frame.moveCenter(scaled.rect().center())
    return scaled.copy(frame)


@lru_cache(maxsize=512)
def _svg(name: str, colour: str) -> QByteArray:
    """Return an icon's SVG in a colour (a cached renderer, a QObject, would not outlive its application)."""
    text = (ICONS / f"{name}.svg").read_bytes()
    return QByteArray(text.replace(b"currentColor", colour.encode()))


class _Engine(QIconEngine):
    """Icon engine that draws an SVG in the state of its control."""

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
