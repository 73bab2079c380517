"""Tree of layers and labels, and the delegate that draws its rows."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from PyQt6.QtCore import QModelIndex, QPoint, QPointF, QRect, QRectF, QSignalBlocker, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QDropEvent, QKeyEvent, QMouseEvent, QPainter
from PyQt6.QtWidgets import (
    QAbstractItemView,
    QFrame,
    QHeaderView,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTreeWidget,
    QTreeWidgetItem,
)

from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.actions import ShortcutOverride
from sketchterrain.ui.look.layer_colours import colour_swatch, swatch
from sketchterrain.ui.look.theme import SMALL, SPACING, draw_icon, tabular
from sketchterrain.ui.panels.controls import draw_band, small

NAME, EYE, LOCK = range(3)
"""Columns."""
_LABEL: Final = Qt.ItemDataRole.UserRole
"""Of the name: layer, label and whether it is the layer's first label."""
_DETAIL: Final = Qt.ItemDataRole.UserRole + 1  # of the name: the second line
_STATE: Final = Qt.ItemDataRole.UserRole + 2
"""Of the eye and the lock: whether the layer is visible or locked; None for no symbol."""
_COLOURS: Final = Qt.ItemDataRole.UserRole + 3  # of the name: those of a draped layer
_SWATCH: Final = 24
ROW_HEIGHT: Final = 34
_ICON: Final = 17
_COLUMN_WIDTH: Final = 32
_DIGITS: Final = (*range(Qt.Key.Key_1, Qt.Key.Key_9 + 1), Qt.Key.Key_0)
"""Keys of the first layers."""


class _LayerDelegate(QStyledItemDelegate):
    """Draws a row of two lines, an eye and a lock."""

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex) -> QSize:
        return QSize(super().sizeHint(option, index).width(), ROW_HEIGHT)

    def paint(self, painter: QPainter | None, option: QStyleOptionViewItem, index: QModelIndex) -> None:
        if painter is None:
            return
        painter.save()
        # One band behind all cells of the row: ends within it lie outside of the cell.
        left = 0.0 if index.column() == NAME else -12.0
        right = 0.0 if index.column() == LOCK else 12.0
        text, pale = draw_band(painter, option, QRectF(option.rect).adjusted(left, 1, right, -1))
        if index.column() == NAME:
            self._draw_name(painter, option, index, text, pale)
        elif index.data(_STATE) is not None:
            _draw_symbol(painter, option.rect, index, text)
        painter.restore()

    def _draw_name(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex, text: QColor, pale: QColor
    ) -> None:
        layer, label, is_first = index.data(_LABEL)
        left = option.rect.left() + SPACING + (0 if is_first else 2 * SPACING)
        top = option.rect.center().y() - _SWATCH // 2 + 1
        device = painter.device()
        dpr = 1.0 if device is None else device.devicePixelRatioF()
        colours = index.data(_COLOURS)
        own = colour_swatch(*colours, _SWATCH, dpr) if colours else swatch(layer, label, _SWATCH, dpr)
        painter.drawPixmap(QPointF(left, top), own)
        room = QRect(option.rect)
        room.setLeft(left + _SWATCH + SPACING + 2)
        half = room.height() // 2
        for line, colour, font, part in (
            (index.data(), text, option.font, room.adjusted(0, SMALL, 0, 1 - half)),
            (index.data(_DETAIL), pale, tabular(small(option.font)), room.adjusted(0, half - 1, 0, -SMALL)),
        ):
            painter.setFont(font)
            painter.setPen(colour)
            elided = painter.fontMetrics().elidedText(line, Qt.TextElideMode.ElideRight, room.width())
            painter.drawText(part, Qt.AlignmentFlag.AlignVCenter, elided)


def _draw_symbol(painter: QPainter, cell: QRect, index: QModelIndex, text: QColor) -> None:
    on = index.data(_STATE)
    if index.column() == EYE:
        name, opacity = ("eye", 0.8) if on else ("eye-off", 0.45)
    else:
        name, opacity = ("lock", 1.0) if on else ("unlock", 0.3)
    place = QRectF(0, 0, _ICON, _ICON)
    place.moveCenter(QRectF(cell).center())
    painter.setOpacity(opacity)
    draw_icon(painter, name, place, text)


class Row(NamedTuple):
    """A label of a layer; the layer's state is shown in the row of its first label only.

    A draped layer is its number, and has colours of its own.
    """

    layer: str
    label: int
    title: str
    detail: str
    visible: bool | None
    locked: bool | None
    colours: tuple[str, str] | None = None  # of lines and areas


class LayerList(QTreeWidget):
    """Layers and their labels. Arrow keys or 1 to 9 and 0 select, Space toggles visibility."""

    label_activated = pyqtSignal(str, int)
    layer_activated = pyqtSignal(str)
    eye_clicked = pyqtSignal(str)
    lock_clicked = pyqtSignal(str)
    delete_requested = pyqtSignal()
    menu_requested = pyqtSignal(QPoint)  # a place on the screen
    moved = pyqtSignal(int, int)  # a row, and that before which it was dropped

    def __init__(self, *, can_move: bool = False) -> None:
        super().__init__()
        if can_move:
            self.setDragDropMode(QAbstractItemView.DragDropMode.InternalMove)
        self.rows: tuple[Row, ...] = ()
        self.setColumnCount(3)
        self.setHeaderHidden(True)
        self.setRootIsDecorated(False)
        self.setIndentation(0)
        self.setUniformRowHeights(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setItemDelegate(_LayerDelegate(self))
        self.setMouseTracking(True)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.setAccessibleName("Layers")
        self.setToolTip("Layers and labels. 1 to 9 and 0 select a layer, Space shows or hides it")
        header = self.header()
        if header is not None:
            header.setStretchLastSection(False)
            header.setMinimumSectionSize(_COLUMN_WIDTH)
            header.setSectionResizeMode(NAME, QHeaderView.ResizeMode.Stretch)
            for column in (EYE, LOCK):
                header.setSectionResizeMode(column, QHeaderView.ResizeMode.Fixed)
                header.resizeSection(column, _COLUMN_WIDTH)
        ShortcutOverride(self, self._accepts)
        self.currentItemChanged.connect(self._activate)
        self.customContextMenuRequested.connect(self._request_menu)

    def show_rows(self, rows: Sequence[Row], current: int) -> None:
        """Show rows without emitting a signal; `current` is the selected one, -1 none."""
        with QSignalBlocker(self):
            while self.topLevelItemCount() > len(rows):
                self.takeTopLevelItem(self.topLevelItemCount() - 1)
            while self.topLevelItemCount() < len(rows):
                self.addTopLevelItem(QTreeWidgetItem())
            for index, row in enumerate(rows):
                item = self.topLevelItem(index)
                if item is not None and (index >= len(self.rows) or self.rows[index] != row):
                    _fill(item, row)
            self.rows = tuple(rows)
            item = self.topLevelItem(current)
            if item is not self.currentItem():
                self.setCurrentItem(item)
                self.scrollToItem(item)

    def keyPressEvent(self, event: QKeyEvent | None) -> None:
        if event is None or not self._accepts(event):
            super().keyPressEvent(event)
            return
        row = self._current()
        if event.key() in _DIGITS:
            self.layer_activated.emit(list(LAYERS)[_DIGITS.index(event.key())])
        elif row is not None and event.key() == Qt.Key.Key_Space:
            self.eye_clicked.emit(row.layer)
        elif event.key() == Qt.Key.Key_Delete:
            self.delete_requested.emit()

    def mousePressEvent(self, e: QMouseEvent | None) -> None:
        index = None if e is None else self.indexAt(e.position().toPoint())
        is_left = e is not None and e.button() == Qt.MouseButton.LeftButton
        if index is None or not is_left or index.column() == NAME or index.data(_STATE) is None:
            super().mousePressEvent(e)
            return
        row = self.rows[index.row()]
        (self.eye_clicked if index.column() == EYE else self.lock_clicked).emit(row.layer)

    def dropEvent(self, event: QDropEvent | None) -> None:
        """Report where a row was dropped; the rows follow from the sketch."""
        if event is None or event.source() is not self:
            return
        index = self.indexAt(event.position().toPoint())
        below = self.dropIndicatorPosition() == QAbstractItemView.DropIndicatorPosition.BelowItem
        to = index.row() + below if index.isValid() else len(self.rows)
        event.setDropAction(Qt.DropAction.IgnoreAction)
        event.accept()
        self.moved.emit(self.indexOfTopLevelItem(self.currentItem()), to)

    def sizeHint(self) -> QSize:
        return QSize(280, ROW_HEIGHT * len(LAYERS) + 4)

    def _accepts(self, event: QKeyEvent) -> bool:
        plain = event.modifiers() in (Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.KeypadModifier)
        own = event.key() in (Qt.Key.Key_Space, Qt.Key.Key_Delete)
        return plain and (own or event.key() in _DIGITS)

    def _current(self) -> Row | None:
        index = self.indexOfTopLevelItem(self.currentItem())
        return self.rows[index] if 0 <= index < len(self.rows) else None

    def _activate(self) -> None:
        row = self._current()
        if row is not None:
            self.label_activated.emit(row.layer, row.label)

    def _request_menu(self, place: QPoint) -> None:
        view = self.viewport()
        if view is not None:
            self.menu_requested.emit(view.mapToGlobal(place))


def _fill(item: QTreeWidgetItem, row: Row) -> None:
    item.setText(NAME, row.title)
    item.setData(NAME, _LABEL, (row.layer, row.label, row.visible is not None))
    item.setData(NAME, _DETAIL, row.detail)
    item.setData(NAME, _COLOURS, row.colours)
    item.setData(NAME, Qt.ItemDataRole.AccessibleTextRole, f"{row.title}, {row.detail}")
    item.setToolTip(NAME, f"{row.title}: {row.detail}")
    for column, on, verbs in ((EYE, row.visible, ("Show", "Hide")), (LOCK, row.locked, ("Lock", "Unlock"))):
        title = row.title if row.colours else LAYERS[row.layer].title.lower()
        text = "" if on is None else f"{verbs[on]} {title}"
        item.setData(column, _STATE, on)
        item.setToolTip(column, text)
        item.setData(column, Qt.ItemDataRole.AccessibleTextRole, text)
