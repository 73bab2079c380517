"""Where painted layers contradict each other, what was decided there, and edits whose feature is gone."""

from __future__ import annotations

from typing import Final

from PyQt6.QtCore import QModelIndex, QSignalBlocker, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QStandardItem, QStandardItemModel
from PyQt6.QtWidgets import QCheckBox, QVBoxLayout, QWidget

from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.look.theme import MARGIN, SMALL
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.list_row import ICON, PALE, plain_list
from sketchterrain.ui.panels.text import faint_label

_PLACE: Final = Qt.ItemDataRole.UserRole + 9


class ContradictionsPanel(QWidget):
    """A list of what was decided; a click on a line shows where."""

    show_place = pyqtSignal(float, float)
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
            self.show_place.emit(*place)


def _item(line: str, icon: str, place: tuple[float, float] | None) -> QStandardItem:
    item = QStandardItem(line[:1].upper() + line[1:])
    item.setData(icon, ICON)
    item.setData(place is None, PALE)
    item.setData(place, _PLACE)
    return item
