"""Lists of the undo history and of contradictions."""

from __future__ import annotations

from typing import Any, Final

from PyQt6.QtCore import QAbstractListModel, QModelIndex, QRect, QRectF, QSignalBlocker, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QPainter, QPalette, QStandardItem, QStandardItemModel
from PyQt6.QtWidgets import QCheckBox, QListView, QStyle, QStyledItemDelegate, QStyleOptionViewItem, QWidget

from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, column, draw_icon
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.numbers import size_text
from sketchterrain.ui.panels.parts import Panel, draw_band, faint_label

ICON: Final = Qt.ItemDataRole.UserRole + 1
"""Name of an icon, or None."""
PALE: Final = Qt.ItemDataRole.UserRole + 2
"""Whether a row has secondary text."""
_PLACE: Final = Qt.ItemDataRole.UserRole + 9
_ICON_SIZE: Final = 16


class _RowDelegate(QStyledItemDelegate):
    """Draws a row with an optional icon; its text may wrap."""

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex) -> QSize:
        view = self.parent()
        width = 240
        if isinstance(view, QListView):
            port = view.viewport()
            width = width if port is None else port.width()
        room = QRect(0, 0, max(60, width - self._inset(index) - SPACING), 10_000)
        needed = option.fontMetrics.boundingRect(room, Qt.TextFlag.TextWordWrap, str(index.data()))
        return QSize(width, needed.height() + 2 * SMALL + 2)

    def paint(self, painter: QPainter | None, option: QStyleOptionViewItem, index: QModelIndex) -> None:
        if painter is None:
            return
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        draw_band(painter, option, QRectF(option.rect).adjusted(2, 1, -2, -1))
        role = QPalette.ColorRole
        is_selected = bool(option.state & QStyle.StateFlag.State_Selected)
        text_role = role.PlaceholderText if index.data(PALE) else role.Text
        colour = option.palette.color(role.HighlightedText if is_selected else text_role)
        name = index.data(ICON)
        if name:
            left, top = option.rect.left() + SPACING, option.rect.top() + SMALL + 2
            draw_icon(painter, name, QRectF(left, top, _ICON_SIZE, _ICON_SIZE), colour)
        painter.setPen(colour)
        text = option.rect.adjusted(self._inset(index), 0, -SPACING, 0)
        flags = Qt.AlignmentFlag.AlignVCenter | Qt.TextFlag.TextWordWrap
        painter.drawText(text, flags, str(index.data()))
        painter.restore()

    def _inset(self, index: QModelIndex) -> int:
        return SPACING + (_ICON_SIZE + SPACING if index.data(ICON) else 0)


def _list_view(name: str, tip: str) -> QListView:
    view = QListView()
    view.setItemDelegate(_RowDelegate(view))
    view.setFrameShape(QListView.Shape.NoFrame)
    view.setMouseTracking(True)
    view.setResizeMode(QListView.ResizeMode.Adjust)
    view.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    view.setVerticalScrollMode(QListView.ScrollMode.ScrollPerPixel)
    view.setEditTriggers(QListView.EditTrigger.NoEditTriggers)
    view.setAccessibleName(name)
    view.setToolTip(tip)
    return view


class HistoryPanel(Panel):
    """List of undo steps; a click goes to a step."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._is_filling = False
        self._steps = _Steps(document, self)
        self.list = _list_view("History", "Click a step to undo or redo up to there")
        self.list.setUniformItemSizes(True)
        self.list.setModel(self._steps)
        self._memory = faint_label()
        self._memory.setContentsMargins(MARGIN - SMALL, SMALL, MARGIN, SMALL)
        column(self, (self.list, 1), self._memory, margins=(SMALL, SMALL, SMALL, 0), spacing=0)
        selection = self.list.selectionModel()
        if selection is not None:
            selection.currentChanged.connect(self._go_to)
        document.history_changed.connect(self._refresh)
        self._refresh()

    def _refresh(self) -> None:
        history = self._document.history
        self._is_filling = True  # blocked signals of the selection would leave removed rows in the list
        self._steps.refresh()
        current = self._steps.index(history.position)
        self.list.setCurrentIndex(current)
        self._is_filling = False
        self.list.scrollTo(current)
        done, undone = history.position, len(history.titles) - 1 - history.position
        steps = f"{done} step{'' if done == 1 else 's'}" + (f", {undone} undone" if undone else "")
        self._memory.setText(f"{steps} · {size_text(history.bytes)}")

    def _go_to(self, index: QModelIndex) -> None:
        if index.isValid() and not self._is_filling:
            self._document.go_to(index.row())


class _Steps(QAbstractListModel):
    """List model of a history's titles."""

    def __init__(self, document: Document, parent: QWidget) -> None:
        super().__init__(parent)
        self._document = document
        self._titles: tuple[str, ...] = ()

    def rowCount(self, parent: QModelIndex | None = None) -> int:
        return 0 if parent is not None and parent.isValid() else len(self._titles)

    def data(self, index: QModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if role == Qt.ItemDataRole.DisplayRole:
            return self._titles[index.row()]
        return index.row() > self._document.history.position if role == PALE else None

    def refresh(self) -> None:
        titles = self._document.history.titles
        if titles != self._titles:
            self.beginResetModel()
            self._titles = titles
            self.endResetModel()
        else:
            self.dataChanged.emit(self.index(0), self.index(len(titles) - 1), [PALE])


class ContradictionsPanel(Panel):
    """List of resolved contradictions; a click on one shows its place."""

    place_activated = pyqtSignal(float, float)
    """A place (m)."""

    def __init__(self, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._workspace, self._link = workspace, link
        self._lines: tuple[object, ...] = ()
        self._model = QStandardItemModel(self)
        self.list = _list_view("Contradictions", "Click a line to see the place")
        self.list.setWordWrap(True)
        self.list.setModel(self._model)
        self.mark = QCheckBox("&Mark them in the sketch")
        self.mark.setAccessibleName("Mark them in the sketch")
        self.mark.setToolTip("Marks where layers contradict each other")
        self._none = faint_label(
            "No layer contradicts another one. A river painted across a mountain would be listed here, "
            "with the valley that it cuts."
        )
        margins = (MARGIN, MARGIN, MARGIN, SMALL)
        column(self, self.mark, self._none, (self.list, 1), 0, margins=margins, spacing=MARGIN)
        self.list.clicked.connect(self._activate)
        self.list.activated.connect(self._activate)
        self.mark.toggled.connect(lambda on: workspace.show_overlay("contradictions", on))
        workspace.overlays_changed.connect(self._show_overlay)
        link.placed_changed.connect(self._refresh)
        self._show_overlay()
        self._refresh()

    def _show_overlay(self) -> None:
        with QSignalBlocker(self.mark):
            self.mark.setChecked("contradictions" in self._workspace.overlays)

    def _refresh(self, *_: object) -> None:
        placed = self._link.placed
        resolutions = () if placed is None else placed.resolutions
        orphans = () if placed is None else placed.orphans
        if (resolutions, orphans) == self._lines:
            return
        self._lines = (resolutions, orphans)
        self._model.clear()
        for line, x, y in resolutions:
            self._model.appendRow(_item(line, "warning", (x, y)))
        for line in orphans:
            self._model.appendRow(_item(f"Edit without its feature: {line}", "delete", None))
        self._none.setHidden(bool(resolutions or orphans))
        self.list.setVisible(bool(resolutions or orphans))

    def _activate(self, index: QModelIndex) -> None:
        place = index.data(_PLACE)
        if place is not None:
            self.place_activated.emit(*place)


def _item(line: str, icon: str, place: tuple[float, float] | None) -> QStandardItem:
    item = QStandardItem(line[:1].upper() + line[1:])
    item.setData(icon, ICON)
    item.setData(place is None, PALE)
    item.setData(place, _PLACE)
    return item
