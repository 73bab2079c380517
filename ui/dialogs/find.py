"""Finding a command by typing what one wants to do."""

from __future__ import annotations

from collections.abc import Iterable

from PyQt6.QtCore import QEvent, QObject, QSize, Qt
from PyQt6.QtGui import QAction, QIcon, QKeyEvent, QKeySequence, QPixmap
from PyQt6.QtWidgets import (
    QDialog,
    QHeaderView,
    QLineEdit,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.ui.look.theme import SPACING, theme


class FindDialog(QDialog):
    """Asks for a command; `chosen` is its action when it was accepted."""

    def __init__(self, actions: Iterable[QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Find a command")
        self._actions = [action for action in actions if action.isEnabled()]
        none = QPixmap(16, 16)
        none.fill(Qt.GlobalColor.transparent)
        self._none = QIcon(none)  # keeps words in line
        self.text = QLineEdit()
        self.text.setPlaceholderText("What do you want to do?")
        self.text.setAccessibleName("What do you want to do?")
        self.list = QTreeWidget()
        self.list.setColumnCount(2)
        self.list.setHeaderHidden(True)
        self.list.setRootIsDecorated(False)
        self.list.setIconSize(QSize(16, 16))
        header = self.list.header()
        if header is not None:
            header.setStretchLastSection(False)
            header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
            header.setSectionResizeMode(1, QHeaderView.ResizeMode.ResizeToContents)
        self.list.setAccessibleName("Commands")
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        rows = QVBoxLayout(self)
        rows.setContentsMargins(SPACING, SPACING, SPACING, SPACING)
        rows.setSpacing(SPACING)
        rows.addWidget(self.text)
        rows.addWidget(self.list)
        self.text.textChanged.connect(self._fill)
        self.text.returnPressed.connect(self.accept)
        self.text.installEventFilter(self)
        self.list.itemClicked.connect(self.accept)
        self._fill("")
        self.resize(440, 360)

    @property
    def chosen(self) -> QAction | None:
        """The action that is marked."""
        item = self.list.currentItem()
        return None if item is None else self._actions[int(item.data(0, Qt.ItemDataRole.UserRole))]

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        """Let the arrows choose in the list while one types."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            step = {Qt.Key.Key_Down: 1, Qt.Key.Key_Up: -1}.get(Qt.Key(event.key()), 0)
            count = self.list.topLevelItemCount()
            if step and count:
                self._mark((self.list.indexOfTopLevelItem(self.list.currentItem()) + step) % count)
                return True
        return super().eventFilter(watched, event)

    def _fill(self, text: str) -> None:
        self.list.clear()
        words = text.lower().split()
        for place, action in enumerate(self._actions):
            said = f"{_plain(action)} {action.statusTip()}".lower()
            if all(word in said for word in words):
                keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
                item = QTreeWidgetItem([_plain(action), keys])
                item.setIcon(0, action.icon() if not action.icon().isNull() else self._none)
                item.setToolTip(0, action.statusTip())
                item.setData(0, Qt.ItemDataRole.UserRole, place)
                item.setForeground(1, theme().faint)
                item.setSizeHint(0, QSize(0, 26))
                self.list.addTopLevelItem(item)
        self._mark(0)

    def _mark(self, row: int) -> None:
        item = self.list.topLevelItem(row)
        if item is not None:
            self.list.setCurrentItem(item)


def _plain(action: QAction) -> str:
    return action.text().replace("&", "").rstrip("…")
