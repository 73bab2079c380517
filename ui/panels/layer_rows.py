"""The list of layers and their labels: a row a label, with a picture, an eye and a lock."""

from __future__ import annotations

from typing import Final

from PyQt6.QtCore import QModelIndex, QPointF, QRect, QRectF, QSize, Qt
from PyQt6.QtGui import QColor, QPainter, QPalette
from PyQt6.QtWidgets import QStyle, QStyledItemDelegate, QStyleOptionViewItem

from sketchterrain.ui.look.icons import draw_icon
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import SMALL, SPACING, tabular
from sketchterrain.ui.panels.text import small

NAME, EYE, LOCK = range(3)
"""Columns."""
PLACE: Final = Qt.ItemDataRole.UserRole
"""Of the first column: the layer and the label."""
DETAIL: Final = Qt.ItemDataRole.UserRole + 1
"""Of the first column: what the label is like, in a few words."""
SHOWN: Final = Qt.ItemDataRole.UserRole + 2
"""Of the eye and of the lock: None where there is none, else whether the layer is shown, or locked."""
_PICTURE: Final = 24
HEIGHT: Final = 34
_ICON: Final = 17


class LayerRow(QStyledItemDelegate):
    """Draws a row."""

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex) -> QSize:
        """Return room for two lines of text, or for an icon."""
        return QSize(super().sizeHint(option, index).width(), HEIGHT)

    def paint(self, painter: QPainter | None, option: QStyleOptionViewItem, index: QModelIndex) -> None:
        """Draw a cell of a row."""
        if painter is None:
            return
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        under = bool(option.state & QStyle.StateFlag.State_MouseOver)
        role = QPalette.ColorRole
        if chosen or under:
            _draw_band(painter, option, index, chosen=chosen)
        text = option.palette.color(role.HighlightedText if chosen else role.Text)
        if index.column() == NAME:
            self._draw_name(painter, option, index, text)
        else:
            _draw_mark(painter, option.rect, index, text)
        painter.restore()

    def _draw_name(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex, text: QColor
    ) -> None:
        layer, label, is_first = index.data(PLACE)
        left = option.rect.left() + SPACING + (0 if is_first else 2 * SPACING)
        top = option.rect.center().y() - _PICTURE // 2 + 1
        device = painter.device()
        dpr = 1.0 if device is None else device.devicePixelRatioF()
        painter.drawPixmap(QPointF(left, top), swatch(layer, label, _PICTURE, dpr))
        room = QRect(option.rect)
        room.setLeft(left + _PICTURE + SPACING + 2)
        painter.setPen(text)
        title = option.fontMetrics.elidedText(index.data(), Qt.TextElideMode.ElideRight, room.width())
        upper = room.adjusted(0, SMALL, 0, -room.height() // 2 + 1)
        painter.drawText(upper, Qt.AlignmentFlag.AlignVCenter, title)
        painter.setFont(tabular(small(option.font)))
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        painter.setPen(text if chosen else option.palette.color(QPalette.ColorRole.PlaceholderText))
        metrics = painter.fontMetrics()
        detail = metrics.elidedText(index.data(DETAIL), Qt.TextElideMode.ElideRight, room.width())
        lower = room.adjusted(0, room.height() // 2 - 1, 0, -SMALL)
        painter.drawText(lower, Qt.AlignmentFlag.AlignVCenter, detail)


def _draw_band(painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex, *, chosen: bool) -> None:
    """Draw one band behind all cells of a row."""
    colour = QColor(option.palette.color(QPalette.ColorRole.Highlight if chosen else QPalette.ColorRole.Mid))
    if not chosen:
        colour.setAlpha(90)
    band = QRectF(option.rect).adjusted(0, 1, 0, -1)
    beyond = 12.0  # the ends that are not this cell's lie outside of it
    if index.column() != NAME:
        band.setLeft(band.left() - beyond)
    if index.column() != LOCK:
        band.setRight(band.right() + beyond)
    painter.setClipRect(option.rect)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(colour)
    painter.drawRoundedRect(band, 5, 5)


def _draw_mark(painter: QPainter, cell: QRect, index: QModelIndex, text: QColor) -> None:
    on = index.data(SHOWN)
    if on is None:
        return
    if index.column() == EYE:
        name, plain = ("eye", 0.8) if on else ("eye-off", 0.45)
    else:
        name, plain = ("lock", 1.0) if on else ("unlock", 0.3)
    place = QRectF(0, 0, _ICON, _ICON)
    place.moveCenter(QRectF(cell).center())
    painter.setOpacity(plain)
    draw_icon(painter, name, place, text)
