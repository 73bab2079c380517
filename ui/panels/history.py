"""The steps that led to the sketch as it is, and those that were undone."""

from __future__ import annotations

from typing import Any

from PyQt6.QtCore import QAbstractListModel, QModelIndex, QSize, Qt
from PyQt6.QtWidgets import QVBoxLayout, QWidget

from sketchterrain.ui.look.theme import MARGIN, SMALL
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.panels.list_row import PALE, plain_list
from sketchterrain.ui.panels.text import faint_label
from sketchterrain.ui.panels.wording import size_text


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
