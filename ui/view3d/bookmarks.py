"""Bookmarks panel: viewpoints with thumbnails."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

from PyQt6.QtCore import QBuffer, QByteArray, QIODevice, QPoint, QSignalBlocker, QSize, Qt
from PyQt6.QtGui import QAction, QIcon, QImage
from PyQt6.QtWidgets import QAbstractItemView, QLabel, QListWidget, QListWidgetItem

from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.engine.protocol import Look
from sketchterrain.ui.look.theme import (
    MARGIN,
    SMALL,
    SPACING,
    column,
    filling,
    rounded_picture,
    row,
    tool_button,
)
from sketchterrain.ui.menus import ContextMenu
from sketchterrain.ui.models.bookmarks import Bookmark, Bookmarks
from sketchterrain.ui.panels.parts import Panel

_THUMBNAIL: Final = QSize(96, 60)  # px
_DPR = 2  # of stored thumbnails
_SHORTCUTS = 9  # Alt+1 … Alt+9


class BookmarksPanel(Panel):
    """List of bookmarks; a click goes to one."""

    def __init__(self, link: ViewSource, bookmarks: Bookmarks) -> None:
        super().__init__()
        self._link, self._bookmarks = link, bookmarks
        self._list = QListWidget()
        self._list.setIconSize(_THUMBNAIL)
        self._list.setSpacing(1)
        self._list.setEditTriggers(QAbstractItemView.EditTrigger.EditKeyPressed)
        self._list.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self._list.setAccessibleName("Bookmarks")
        self._list.setToolTip("Click a bookmark to go there; F2 renames it")
        self._empty = QLabel("No bookmarks yet.\nAdd the current view with + below.")
        self._empty.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._empty.setEnabled(False)
        column(self._list, self._empty, margins=-1, spacing=-1)
        self._error = QLabel()
        self._error.setWordWrap(True)
        self._error.hide()
        self._add = tool_button("add", "Add the current view as a bookmark")
        self._replace = tool_button("camera", "Replace the bookmark's view with the current one")
        self._delete = tool_button("delete", "Delete the bookmark")
        buttons = row(None, self._add, self._replace, 1, self._delete, spacing=SMALL)
        column(self, (self._list, 1), self._error, buttons, margins=(MARGIN, SPACING, MARGIN, SPACING))
        self._connect()
        self._refresh()

    def _connect(self) -> None:
        self._list.itemClicked.connect(self._go)
        self._list.itemActivated.connect(self._go)
        self._list.itemChanged.connect(self._rename)
        self._list.currentRowChanged.connect(self._update_buttons)
        self._list.customContextMenuRequested.connect(self._open_menu)
        delete_key = QAction(self._list)
        delete_key.setShortcut(Qt.Key.Key_Delete)
        delete_key.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
        delete_key.triggered.connect(self.delete_current)
        self._list.addAction(delete_key)
        self._add.clicked.connect(self.add)
        self._replace.clicked.connect(self.replace_current)
        self._delete.clicked.connect(self.delete_current)
        self._link.frame_shown.connect(self._update_buttons)
        self._bookmarks.changed.connect(self._refresh)
        self._bookmarks.failed.connect(self._show_error)

    def go_to(self, index: int) -> None:
        """Go to the viewpoint of a bookmark if it exists."""
        if 0 <= index < len(self._bookmarks.all):
            bookmark = self._bookmarks.all[index]
            self._link.set_view(replace(self._link.view, mode=bookmark.mode))
            self._link.send(Look(bookmark.pose))
            self._list.setCurrentRow(index)

    def add(self) -> None:
        """Add the current view, if there is a picture."""
        bookmark = self._current_view(self._bookmarks.free_name())
        if bookmark is not None:
            self._bookmarks.add(bookmark)
            self._list.setCurrentRow(len(self._bookmarks.all) - 1)

    def replace_current(self) -> None:
        """Replace the selected bookmark's view with the current one."""
        index, bookmark = self._list.currentRow(), self._current_view("")
        if index >= 0 and bookmark is not None:
            self._bookmarks.renew(index, bookmark)

    def delete_current(self) -> None:
        index = self._list.currentRow()
        if index >= 0:
            self._bookmarks.delete(index)

    def _current_view(self, name: str) -> Bookmark | None:
        frame, picture = self._link.frame, self._link.picture
        if frame is None or picture is None:
            return None
        return Bookmark(name, frame.pose, self._link.view.mode, _thumbnail(picture))

    def _refresh(self) -> None:
        current = self._list.currentRow()
        with QSignalBlocker(self._list):
            self._list.clear()
            for number, bookmark in enumerate(self._bookmarks.all, start=1):
                image = QImage.fromData(bookmark.picture)
                item = QListWidgetItem(QIcon(rounded_picture(image, _THUMBNAIL, _DPR)), bookmark.name)
                item.setFlags(item.flags() | Qt.ItemFlag.ItemIsEditable)
                if number <= _SHORTCUTS:
                    item.setToolTip(f"{bookmark.name} (Alt+{number})")
                self._list.addItem(item)
        self._list.setCurrentRow(min(current, self._list.count() - 1))
        self._empty.setVisible(not self._bookmarks.all)
        self._error.hide()
        self._update_buttons()

    def _update_buttons(self, *_: object) -> None:
        has_picture, is_selected = self._link.picture is not None, self._list.currentRow() >= 0
        self._add.setEnabled(has_picture)
        self._replace.setEnabled(has_picture and is_selected)
        self._delete.setEnabled(is_selected)

    def _go(self, item: QListWidgetItem) -> None:
        self.go_to(self._list.row(item))

    def _rename(self, item: QListWidgetItem) -> None:
        self._bookmarks.rename(self._list.row(item), item.text())
        self._refresh()

    def _show_error(self, line: str) -> None:
        self._error.setText(line)
        self._error.show()

    def _open_menu(self, at: QPoint) -> None:
        item = self._list.itemAt(at)
        if item is None:
            return
        menu = ContextMenu(self)
        menu.add_command("eye", "Go to this view", partial(self._go, item))
        menu.add_command("", "Rename", partial(self._list.editItem, item))
        menu.add_command("camera", "Use the current view", self.replace_current)
        menu.add_command("delete", "Delete", self.delete_current)
        self._list.setCurrentItem(item)
        menu.popup(self._list.mapToGlobal(at))


def _thumbnail(picture: QImage) -> bytes:
    """Return the middle of a picture as a small JPEG."""
    data = QByteArray()
    buffer = QBuffer(data)
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    filling(picture, _THUMBNAIL * _DPR).save(buffer, "JPEG", 82)
    return data.data()
