"""The tree of layers and labels, and the delegate that draws its rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from PyQt6.QtCore import QModelIndex, QPoint, QPointF, QRect, QRectF, QSignalBlocker, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QKeyEvent, QMouseEvent, QPainter, QPalette
from PyQt6.QtWidgets import (
    QAbstractItemView,
    QFrame,
    QHeaderView,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from sketchterrain.document.parameters import LAYERS
from sketchterrain.ui.actions import ShortcutOverride
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import SMALL, SPACING, draw_icon, tabular
from sketchterrain.ui.panels.parts import small

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
        selection = bool(option.state & QStyle.StateFlag.State_Selected)
        under = bool(option.state & QStyle.StateFlag.State_MouseOver)
        role = QPalette.ColorRole
        if selection or under:
            _draw_band(painter, option, index, selection=selection)
        text = option.palette.color(role.HighlightedText if selection else role.Text)
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
        selection = bool(option.state & QStyle.StateFlag.State_Selected)
        painter.setPen(text if selection else option.palette.color(QPalette.ColorRole.PlaceholderText))
        metrics = painter.fontMetrics()
        detail = metrics.elidedText(index.data(DETAIL), Qt.TextElideMode.ElideRight, room.width())
        lower = room.adjusted(0, room.height() // 2 - 1, 0, -SMALL)
        painter.drawText(lower, Qt.AlignmentFlag.AlignVCenter, detail)


def _draw_band(
    painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex, *, selection: bool
) -> None:
    """Draw one band behind all cells of a row."""
    colour = QColor(
        option.palette.color(QPalette.ColorRole.Highlight if selection else QPalette.ColorRole.Mid)
    )
    if not selection:
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


_COLUMN = 32


class Row(NamedTuple):
    """What a row shows.

    Attributes
    ----------
    layer, label : str, int
    title, detail : str
        Its two lines.
    visible, locked : bool or None
        Of the layer, in the first of its rows; None in the others.
    """

    layer: str
    label: int
    title: str
    detail: str
    visible: bool | None
    locked: bool | None


class LayerList(QTreeWidget):
    """Layers and their labels. Up and down, or 1 to 7, choose; Space shows and hides."""

    selection = pyqtSignal(str, int)
    """A person wants to paint on a layer with a label."""
    layer_chosen = pyqtSignal(str)
    """A person wants to paint on a layer."""
    eye_clicked = pyqtSignal(str)
    lock_clicked = pyqtSignal(str)
    delete_asked = pyqtSignal()
    menu_asked = pyqtSignal(QPoint)
    """A place on the screen."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._rows: list[Row] = []
        self.setColumnCount(3)
        self.setHeaderHidden(True)
        self.setRootIsDecorated(False)
        self.setIndentation(0)
        self.setUniformRowHeights(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setItemDelegate(LayerRow(self))
        self.setMouseTracking(True)
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.setAccessibleName("Layers")
        self.setToolTip("What is painted. 1 to 7 choose a layer, Space shows or hides it")
        self._size_columns()
        ShortcutOverride(self, self._is_own)
        self.currentItemChanged.connect(self._choose)
        self.customContextMenuRequested.connect(self._ask_menu)

    @property
    def rows(self) -> tuple[Row, ...]:
        """What it shows, from top to bottom."""
        return tuple(self._rows)

    def show_rows(self, rows: Sequence[Row], current: int) -> None:
        """Show rows, one of them as the current one; tells nobody."""
        with QSignalBlocker(self):
            while self.topLevelItemCount() > len(rows):
                self.takeTopLevelItem(self.topLevelItemCount() - 1)
            while self.topLevelItemCount() < len(rows):
                self.addTopLevelItem(QTreeWidgetItem())
            for at, row in enumerate(rows):
                item = self.topLevelItem(at)
                if item is not None and (at >= len(self._rows) or self._rows[at] != row):
                    _fill(item, row)
            self._rows = list(rows)
            item = self.topLevelItem(current)
            if item is not None and item is not self.currentItem():
                self.setCurrentItem(item)
                self.scrollToItem(item)

    def keyPressEvent(self, event: QKeyEvent | None) -> None:
        """Choose a layer, show and hide it, or delete a label."""
        if event is None or not self._is_own(event):
            super().keyPressEvent(event)
            return
        row = self._current()
        number = event.key() - Qt.Key.Key_1
        if 0 <= number < len(LAYERS):
            self.layer_chosen.emit(list(LAYERS)[number])
        elif row is not None and event.key() == Qt.Key.Key_Space:
            self.eye_clicked.emit(row.layer)
        elif event.key() == Qt.Key.Key_Delete:
            self.delete_asked.emit()

    def mousePressEvent(self, e: QMouseEvent | None) -> None:
        """Turn an eye or a lock, or choose a row."""
        at = None if e is None else self.indexAt(e.position().toPoint())
        left = e is not None and e.button() == Qt.MouseButton.LeftButton
        if at is None or not left or at.column() == NAME or at.data(SHOWN) is None:
            super().mousePressEvent(e)
            return
        row = self._rows[at.row()]
        (self.eye_clicked if at.column() == EYE else self.lock_clicked).emit(row.layer)

    def sizeHint(self) -> QSize:
        """Return room for a row a layer."""
        return QSize(280, HEIGHT * len(LAYERS) + 4)

    def _is_own(self, event: QKeyEvent) -> bool:
        plain = event.modifiers() in (Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.KeypadModifier)
        own = event.key() in (Qt.Key.Key_Space, Qt.Key.Key_Delete)
        return plain and (own or 0 <= event.key() - Qt.Key.Key_1 < len(LAYERS))

    def _current(self) -> Row | None:
        at = self.indexOfTopLevelItem(self.currentItem())
        return self._rows[at] if 0 <= at < len(self._rows) else None

    def _choose(self) -> None:
        row = self._current()
        if row is not None:
            self.selection.emit(row.layer, row.label)

    def _ask_menu(self, place: QPoint) -> None:
        view = self.viewport()
        if view is not None:
            self.menu_asked.emit(view.mapToGlobal(place))

    def _size_columns(self) -> None:
        header = self.header()
        if header is not None:
            header.setStretchLastSection(False)
            header.setMinimumSectionSize(_COLUMN)
            header.setSectionResizeMode(NAME, QHeaderView.ResizeMode.Stretch)
            for column in (EYE, LOCK):
                header.setSectionResizeMode(column, QHeaderView.ResizeMode.Fixed)
                header.resizeSection(column, _COLUMN)


def _fill(item: QTreeWidgetItem, row: Row) -> None:
    name = LAYERS[row.layer].title.lower()
    item.setText(NAME, row.title)
    item.setData(NAME, PLACE, (row.layer, row.label, row.visible is not None))
    item.setData(NAME, DETAIL, row.detail)
    item.setData(NAME, Qt.ItemDataRole.AccessibleTextRole, f"{row.title}, {row.detail}")
    item.setToolTip(NAME, f"{row.title}: {row.detail}")
    item.setData(EYE, SHOWN, row.visible)
    item.setData(LOCK, SHOWN, row.locked)
    shown, held = ("Hide" if row.visible else "Show"), ("Unlock" if row.locked else "Lock")
    for column, on, verb in ((EYE, row.visible, shown), (LOCK, row.locked, held)):
        text = "" if on is None else f"{verb} {name}"
        item.setToolTip(column, text)
        item.setData(column, Qt.ItemDataRole.AccessibleTextRole, text)
