"""Rows of a list: a line of text, another one beneath it where there is one, on a band where it is chosen."""

from __future__ import annotations

from typing import Final

from PyQt6.QtCore import QModelIndex, QRect, QRectF, QSize, Qt
from PyQt6.QtGui import QColor, QPainter, QPalette
from PyQt6.QtWidgets import QListView, QStyle, QStyledItemDelegate, QStyleOptionViewItem, QWidget

from sketchterrain.ui.look.icons import draw_icon
from sketchterrain.ui.look.theme import SMALL, SPACING

ICON: Final = Qt.ItemDataRole.UserRole + 1
"""Name of an icon before the text; None: there is none."""
PALE: Final = Qt.ItemDataRole.UserRole + 2
"""Whether a row is read second."""
_SIDE: Final = 16


class ListRow(QStyledItemDelegate):
    """Draws a row; its text may take several lines."""

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex) -> QSize:
        """Return room for all lines at the list's width."""
        view = self.parent()
        width = 240
        if isinstance(view, QListView):
            port = view.viewport()
            width = width if port is None else port.width()
        room = QRect(0, 0, max(60, width - self._inset(index) - SPACING), 10_000)
        needed = option.fontMetrics.boundingRect(room, Qt.TextFlag.TextWordWrap, str(index.data()))
        return QSize(width, needed.height() + 2 * SMALL + 2)

    def paint(self, painter: QPainter | None, option: QStyleOptionViewItem, index: QModelIndex) -> None:
        """Draw a row."""
        if painter is None:
            return
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        role = QPalette.ColorRole
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        if chosen or option.state & QStyle.StateFlag.State_MouseOver:
            band = QColor(option.palette.color(role.Highlight if chosen else role.Mid))
            band.setAlpha(255 if chosen else 90)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(band)
            painter.drawRoundedRect(QRectF(option.rect).adjusted(2, 1, -2, -1), 5, 5)
        faint = role.PlaceholderText if index.data(PALE) else role.Text
        colour = option.palette.color(role.HighlightedText if chosen else faint)
        name = index.data(ICON)
        if name:
            place = QRectF(option.rect.left() + SPACING, option.rect.top() + SMALL + 2, _SIDE, _SIDE)
            draw_icon(painter, name, place, colour)
        painter.setPen(colour)
        text = option.rect.adjusted(self._inset(index), 0, -SPACING, 0)
        flags = Qt.AlignmentFlag.AlignVCenter | Qt.TextFlag.TextWordWrap
        painter.drawText(text, flags, str(index.data()))
        painter.restore()

    def _inset(self, index: QModelIndex) -> int:
        return SPACING + (_SIDE + SPACING if index.data(ICON) else 0)


def plain_list(name: str, tip: str, parent: QWidget) -> QListView:
    """Return an empty list of such rows."""
    view = QListView(parent)
    view.setItemDelegate(ListRow(view))
    view.setFrameShape(QListView.Shape.NoFrame)
    view.setMouseTracking(True)
    view.setResizeMode(QListView.ResizeMode.Adjust)
    view.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    view.setVerticalScrollMode(QListView.ScrollMode.ScrollPerPixel)
    view.setEditTriggers(QListView.EditTrigger.NoEditTriggers)
    view.setAccessibleName(name)
    view.setToolTip(tip)
    return view
