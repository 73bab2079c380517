"""The history and the contradictions as lists."""

from __future__ import annotations

from typing import Any, Final

from PyQt6.QtCore import QAbstractListModel, QModelIndex, QRect, QRectF, QSignalBlocker, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QPainter, QPalette, QStandardItem, QStandardItemModel
from PyQt6.QtWidgets import (
    QCheckBox,
    QListView,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, draw_icon
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.numbers import size_text
from sketchterrain.ui.panels.parts import faint_label

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
        selection = bool(option.state & QStyle.StateFlag.State_Selected)
        if selection or option.state & QStyle.StateFlag.State_MouseOver:
            band = QColor(option.palette.color(role.Highlight if selection else role.Mid))
            band.setAlpha(255 if selection else 90)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(band)
            painter.drawRoundedRect(QRectF(option.rect).adjusted(2, 1, -2, -1), 5, 5)
        faint = role.PlaceholderText if index.data(PALE) else role.Text
        colour = option.palette.color(role.HighlightedText if selection else faint)
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


class HistoryPanel(QWidget):
    """A list of steps; a click on one goes there."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._filling = False
        self._steps = _Steps(document, self)
        self.list = plain_list("History", "Click a step to undo or redo up to there", self)
        self.list.setUniformItemSizes(True)
        self.list.setModel(self._steps)
        self._memory = faint_label("", self)
        self._memory.setContentsMargins(MARGIN - SMALL, SMALL, MARGIN, SMALL)
        down = QVBoxLayout(self)
        down.setContentsMargins(SMALL, SMALL, SMALL, 0)
        down.setSpacing(0)
        down.addWidget(self.list, 1)
        down.addWidget(self._memory)
        selection = self.list.selectionModel()
        if selection is not None:
            selection.currentChanged.connect(self._go)
        document.history_changed.connect(self._refresh)
        self._refresh()

    def sizeHint(self) -> QSize:
        """Return room for a dozen steps."""
        return QSize(300, 320)

    def minimumSizeHint(self) -> QSize:
        """Return room for a few steps."""
        return QSize(220, 80)

    def _refresh(self) -> None:
        history = self._document.history
        self._filling = True  # a blocked selection would leave the list with what is gone
        self._steps.refresh()
        current = self._steps.index(history.position)
        self.list.setCurrentIndex(current)
        self._filling = False
        self.list.scrollTo(current)
        done, undone = history.position, len(history.titles) - 1 - history.position
        words = f"{done} step{'' if done == 1 else 's'}" + (f", {undone} undone" if undone else "")
        self._memory.setText(f"{words} · {size_text(history.bytes)}")

    def _go(self, index: QModelIndex) -> None:
        if index.isValid() and not self._filling:
            self._document.go_to(index.row())


class _Steps(QAbstractListModel):
    """The titles of a history."""

    def __init__(self, document: Document, parent: QWidget) -> None:
        super().__init__(parent)
        self._document = document
        self._titles: tuple[str, ...] = ()

    def rowCount(self, parent: QModelIndex | None = None) -> int:
        return 0 if parent is not None and parent.isValid() else len(self._titles)

    def data(self, index: QModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if role == Qt.ItemDataRole.DisplayRole:
            return self._titles[index.row()]
        if role == PALE:
            return index.row() > self._document.history.position
        return None

    def refresh(self) -> None:
        titles = self._document.history.titles
        if titles != self._titles:
            self.beginResetModel()
            self._titles = titles
            self.endResetModel()
        else:
            self.dataChanged.emit(self.index(0), self.index(len(titles) - 1), [PALE])


_PLACE: Final = Qt.ItemDataRole.UserRole + 9


class ContradictionsPanel(QWidget):
    """A list of what was decided; a click on a line shows where."""

    place_activated = pyqtSignal(float, float)
    """A person wants to see a place (m)."""

    def __init__(self, workspace: Workspace, link: EngineLink, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._link = link
        self._lines: tuple[object, ...] = ()
        self._model = QStandardItemModel(self)
        self.list = plain_list("Contradictions", "Click a line to see the place", self)
        self.list.setWordWrap(True)
        self.list.setModel(self._model)
        self.mark = QCheckBox("&Mark them in the sketch", self)
        self.mark.setAccessibleName("Mark them in the sketch")
        self.mark.setToolTip("Marks where layers contradict each other")
        self._none = faint_label(
            "No layer contradicts another one. A river painted across a mountain would be listed here, "
            "with the valley that it cuts.",
            self,
        )
        self._lay_out()
        self.list.clicked.connect(self._show)
        self.list.activated.connect(self._show)
        self.mark.toggled.connect(lambda on: workspace.show_overlay("contradictions", on))
        workspace.overlays_changed.connect(self._fill_mark)
        link.placed_changed.connect(self._fill)
        self._fill_mark()
        self._fill()

    def sizeHint(self) -> QSize:
        """Return room for a few lines."""
        return QSize(300, 240)

    def minimumSizeHint(self) -> QSize:
        """Return room for two lines."""
        return QSize(220, 80)

    def _lay_out(self) -> None:
        down = QVBoxLayout(self)
        down.setContentsMargins(MARGIN, MARGIN, MARGIN, SMALL)
        down.setSpacing(MARGIN)
        down.addWidget(self.mark)
        down.addWidget(self._none)
        down.addWidget(self.list, 1)
        down.addStretch(0)

    def _fill_mark(self) -> None:
        with QSignalBlocker(self.mark):
            self.mark.setChecked("contradictions" in self._workspace.overlays)

    def _fill(self) -> None:
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

    def _show(self, index: QModelIndex) -> None:
        place = index.data(_PLACE)
        if place is not None:
            self.place_activated.emit(*place)


def _item(line: str, icon: str, place: tuple[float, float] | None) -> QStandardItem:
    item = QStandardItem(line[:1].upper() + line[1:])
    item.setData(icon, ICON)
    item.setData(place is None, PALE)
    item.setData(place, _PLACE)
    return item
