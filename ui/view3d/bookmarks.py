"""The panel of bookmarks: places to look from, with small pictures."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

from PyQt6.QtCore import QBuffer, QByteArray, QIODevice, QPoint, QSize, Qt
from PyQt6.QtGui import QAction, QIcon, QImage, QPainter, QPainterPath, QPixmap
from PyQt6.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.engine.protocol import Look
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, tool_button
from sketchterrain.ui.menus import ContextMenu
from sketchterrain.ui.models.bookmarks import Bookmark, Bookmarks

_PICTURE: Final = QSize(96, 60)
"""px of a bookmark's picture."""
_FINER = 2  # as screens may be
_BY_KEY = 9  # that Alt and a figure go to


class BookmarksPanel(QWidget):
    """Lists bookmarks; a click looks from there."""

    def __init__(self, link: ViewSource, bookmarks: Bookmarks, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._link, self._bookmarks = link, bookmarks
        self._list = QListWidget(self)
        self._list.setIconSize(_PICTURE)
        self._list.setSpacing(1)
        self._list.setEditTriggers(QAbstractItemView.EditTrigger.EditKeyPressed)
        self._list.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self._list.setAccessibleName("Bookmarks")
        self._list.setToolTip("Click a bookmark to look from there; F2 renames it")
        self._empty = QLabel("No bookmarks yet.\nKeep a view with the + below.", self._list)
        self._empty.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._empty.setEnabled(False)
        self._trouble = QLabel(self)
        self._trouble.setWordWrap(True)
        self._trouble.hide()
        self._add = tool_button("add", "Keep this view as a bookmark", parent=self)
        self._renew = tool_button("camera", "Let the bookmark be about this view", parent=self)
        self._delete = tool_button("delete", "Delete the bookmark", parent=self)
        buttons = QHBoxLayout()
        buttons.setSpacing(SMALL)
        for button in (self._add, self._renew):
            buttons.addWidget(button)
        buttons.addStretch(1)
        buttons.addWidget(self._delete)
        rows = QVBoxLayout(self)
        rows.setContentsMargins(MARGIN, SPACING, MARGIN, SPACING)
        rows.setSpacing(SPACING)
        rows.addWidget(self._list, 1)
        rows.addWidget(self._trouble)
        rows.addLayout(buttons)
        hint = QVBoxLayout(self._list)
        hint.addWidget(self._empty)
        self._connect()
        self._fill()

    def _connect(self) -> None:
        self._list.itemClicked.connect(self._go)
        self._list.itemActivated.connect(self._go)
        self._list.itemChanged.connect(self._renamed)
        self._list.currentRowChanged.connect(self._show_buttons)
        self._list.customContextMenuRequested.connect(self._open_menu)
        remove = QAction(self._list)
        remove.setShortcut(Qt.Key.Key_Delete)
        remove.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
        remove.triggered.connect(self.delete_current)
        self._list.addAction(remove)
        self._add.clicked.connect(self.add)
        self._renew.clicked.connect(self.renew_current)
        self._delete.clicked.connect(self.delete_current)
        self._link.frame_shown.connect(self._show_buttons)
        self._bookmarks.changed.connect(self._fill)
        self._bookmarks.failed.connect(self._tell)

    def sizeHint(self) -> QSize:
        """Return a size to begin with."""
        return QSize(300, 260)

    def minimumSizeHint(self) -> QSize:
        """Return the least size."""
        return QSize(220, 80)

    def go_to(self, index: int) -> None:
        """Look from a bookmark's place, counted from 0; nothing happens if there is none."""
        if 0 <= index < len(self._bookmarks.all):
            bookmark = self._bookmarks.all[index]
            self._link.set_view(replace(self._link.view, mode=bookmark.mode))
            self._link.send(Look(bookmark.pose))
            self._list.setCurrentRow(index)

    def add(self) -> None:
        """Keep the view as it is now; nothing happens before there is one."""
        bookmark = self._now(self._bookmarks.free_name())
        if bookmark is not None:
            self._bookmarks.add(bookmark)
            self._list.setCurrentRow(len(self._bookmarks.all) - 1)

    def renew_current(self) -> None:
        """Let the bookmark that is selected be about the view as it is now."""
        row, bookmark = self._list.currentRow(), self._now("")
        if row >= 0 and bookmark is not None:
            self._bookmarks.renew(row, bookmark)

    def delete_current(self) -> None:
        """Delete the bookmark that is selected."""
        row = self._list.currentRow()
        if row >= 0:
            self._bookmarks.delete(row)

    def _now(self, name: str) -> Bookmark | None:
        frame, picture = self._link.frame, self._link.picture
        if frame is None or picture is None:
            return None
        return Bookmark(name, frame.pose, self._link.view.mode, _small(picture))

    def _fill(self) -> None:
        """Show what is kept; what was selected stays so."""
        row = self._list.currentRow()
        self._list.blockSignals(True)
        self._list.clear()
        for number, bookmark in enumerate(self._bookmarks.all, start=1):
            item = QListWidgetItem(_icon(bookmark.picture), bookmark.name)
            item.setFlags(item.flags() | Qt.ItemFlag.ItemIsEditable)
            if number <= _BY_KEY:
                item.setToolTip(f"{bookmark.name} (Alt+{number})")
            self._list.addItem(item)
        self._list.blockSignals(False)
        self._list.setCurrentRow(min(row, self._list.count() - 1))
        self._empty.setVisible(not self._bookmarks.all)
        self._trouble.hide()
        self._show_buttons()

    def _show_buttons(self, *_: object) -> None:
        there, selection = self._link.picture is not None, self._list.currentRow() >= 0
        self._add.setEnabled(there)
        self._renew.setEnabled(there and selection)
        self._delete.setEnabled(selection)

    def _go(self, item: QListWidgetItem) -> None:
        self.go_to(self._list.row(item))

    def _renamed(self, item: QListWidgetItem) -> None:
        self._bookmarks.rename(self._list.row(item), item.text())
        self._fill()

    def _tell(self, line: str) -> None:
        self._trouble.setText(line)
        self._trouble.show()

    def _open_menu(self, at: QPoint) -> None:
        item = self._list.itemAt(at)
        if item is None:
            return
        menu = ContextMenu(self)
        menu.add_command("eye", "Look from here", partial(self._go, item))
        menu.add_command("", "Rename", partial(self._list.editItem, item))
        menu.add_command("camera", "Use this view", self.renew_current)
        menu.add_command("delete", "Delete", self.delete_current)
        self._list.setCurrentItem(item)
        menu.popup(self._list.mapToGlobal(at))


def _small(picture: QImage) -> bytes:
    """Return the middle of a picture as a small JPEG."""
    size = _PICTURE * _FINER
    wide = picture.scaled(
        size, Qt.AspectRatioMode.KeepAspectRatioByExpanding, Qt.TransformationMode.SmoothTransformation
    )
    left, top = (wide.width() - size.width()) // 2, (wide.height() - size.height()) // 2
    data = QByteArray()
    buffer = QBuffer(data)
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    wide.copy(left, top, size.width(), size.height()).save(buffer, "JPEG", 82)
    return data.data()


def _icon(picture: bytes) -> QIcon:
    """Return a bookmark's picture with round corners; an empty plate if there is none."""
    size = _PICTURE * _FINER
    shown = QPixmap(size)
    shown.fill(Qt.GlobalColor.transparent)
    painter = QPainter(shown)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    path = QPainterPath()
    path.addRoundedRect(0.0, 0.0, size.width(), size.height(), 6.0 * _FINER, 6.0 * _FINER)
    painter.setClipPath(path)
    image = QImage.fromData(picture)
    painter.fillPath(path, Qt.GlobalColor.darkGray)
    if not image.isNull():
        painter.drawImage(0, 0, image)
    painter.end()
    shown.setDevicePixelRatio(_FINER)
    return QIcon(shown)
