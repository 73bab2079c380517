"""Lists of the undo history, contradictions and bookmarks."""

from functools import partial
from typing import Final

from PyQt6.QtCore import QBuffer, QByteArray, QIODevice, QPoint, QSignalBlocker, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QIcon, QImage, QShortcut
from PyQt6.QtWidgets import QAbstractItemView, QLabel, QListWidget, QListWidgetItem

from sketchterrain.ui.actions import ContextMenu
from sketchterrain.ui.engine.link import EngineLink, ViewSource
from sketchterrain.ui.engine.protocol import Look
from sketchterrain.ui.look.theme import (
    MARGIN,
    SMALL,
    SPACING,
    active_theme,
    column,
    described,
    filling,
    icon,
    rounded_picture,
    row,
    theme,
    tool_button,
)
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Bookmark, Bookmarks, Workspace
from sketchterrain.ui.panels.controls import Panel, check_box, faint_label, size_text

_PLACE: Final = Qt.ItemDataRole.UserRole  # m, that a line is about


def _list_of_lines(name: str, tip: str) -> QListWidget:
    """Return a list of lines, which wrap."""
    lines = described(QListWidget(), name, tip)
    lines.setObjectName("lines")
    lines.setFrameShape(QListWidget.Shape.NoFrame)
    lines.setWordWrap(True)
    lines.setResizeMode(QListWidget.ResizeMode.Adjust)
    lines.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    lines.setVerticalScrollMode(QListWidget.ScrollMode.ScrollPerPixel)
    return lines


def _line(
    text: str, name: str = "", *, place: tuple[float, float] | None = None, is_pale: bool = False
) -> QListWidgetItem:
    """Return a line with an icon by its name, and the place (m) that it is about."""
    item = QListWidgetItem(text[:1].upper() + text[1:])
    if name:
        item.setIcon(icon(name))
    if is_pale:
        item.setForeground(theme().faint)
    item.setData(_PLACE, place)
    return item


class HistoryPanel(Panel):
    """List of undo steps; a click goes to a step."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self.list = _list_of_lines("History", "Click a step to undo or redo up to there")
        self._memory = faint_label()
        self._memory.setContentsMargins(MARGIN - SMALL, SMALL, MARGIN, SMALL)
        column(self, (self.list, 1), self._memory, margins=(SMALL, SMALL, SMALL, 0), spacing=0)
        self.list.currentRowChanged.connect(document.go_to)
        document.history_changed.connect(self._refresh)
        active_theme.changed.connect(self._refresh)
        self._refresh()

    def _refresh(self) -> None:
        history = self._document.history
        with QSignalBlocker(self.list):
            self.list.clear()
            for number, title in enumerate(history.titles):
                self.list.addItem(_line(title, is_pale=number > history.position))
            self.list.setCurrentRow(history.position)
        done, undone = history.position, len(history.titles) - 1 - history.position
        steps = f"{done} step{'' if done == 1 else 's'}" + (f", {undone} undone" if undone else "")
        self._memory.setText(f"{steps} · {size_text(history.bytes)}")


class ContradictionsPanel(Panel):
    """List of resolved contradictions and findings about roads; a click on one shows its place."""

    place_activated = pyqtSignal(float, float)  # a place (m)

    def __init__(self, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._workspace, self._link = workspace, link
        self._lines: tuple[object, ...] = ()
        self.list = _list_of_lines("Contradictions", "Click a line to see the place")
        self.mark = check_box("&Mark them in the sketch", "Marks where layers contradict each other")
        self._none = faint_label(
            "No layer contradicts another one. A river painted across a mountain would be listed here, "
            "with the valley that it cuts."
        )
        margins = (MARGIN, MARGIN, MARGIN, SMALL)
        column(self, self.mark, self._none, (self.list, 1), 0, margins=margins, spacing=MARGIN)
        self.list.itemClicked.connect(self._activate)
        self.list.itemActivated.connect(self._activate)
        self.mark.toggled.connect(lambda on: workspace.show_overlay("contradictions", on))
        workspace.overlays_changed.connect(self._show_overlay)
        link.placed_changed.connect(self._refresh)
        self._show_overlay()
        self._refresh()

    def _show_overlay(self) -> None:
        self.mark.setChecked("contradictions" in self._workspace.overlays)

    def _refresh(self, *_: object) -> None:
        placed = self._link.placed
        lines = placed.resolutions, placed.findings, placed.orphans
        if lines == self._lines:
            return
        self._lines = lines
        self.list.clear()
        for line, x, y in placed.resolutions:
            self.list.addItem(_line(line, "warning", place=(x, y)))
        for line, place in placed.findings:
            self.list.addItem(_line(line, "info", place=place))
        for line in placed.orphans:
            self.list.addItem(_line(f"Edit without its feature: {line}", "delete", is_pale=True))
        self._none.setHidden(self.list.count() > 0)
        self.list.setVisible(self.list.count() > 0)

    def _activate(self, item: QListWidgetItem) -> None:
        place = item.data(_PLACE)
        if place is not None:
            self.place_activated.emit(*place)


_THUMBNAIL: Final = QSize(96, 60)  # px
_DPR = 2  # of stored thumbnails
_SHORTCUTS = 9  # Alt+1 … Alt+9


class BookmarksPanel(Panel):
    """List of bookmarks; a click goes to one."""

    def __init__(self, link: ViewSource, bookmarks: Bookmarks) -> None:
        super().__init__()
        self._link, self._bookmarks = link, bookmarks
        self._list = described(QListWidget(), "Bookmarks", "Click a bookmark to go there; F2 renames it")
        self._list.setIconSize(_THUMBNAIL)
        self._list.setSpacing(1)
        self._list.setEditTriggers(QAbstractItemView.EditTrigger.EditKeyPressed)
        self._list.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self._empty = QLabel("No bookmarks yet.\nAdd the current view with + below.")
        self._empty.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._empty.setEnabled(False)
        column(self._list, self._empty, margins=-1, spacing=-1)
        self._error = QLabel()
        self._error.setWordWrap(True)
        self._error.hide()
        self._add = tool_button("add", "Add the current view as a bookmark", self.add)
        tip = "Replace the bookmark's view with the current one"
        self._replace = tool_button("camera", tip, self.replace_current)
        self._delete = tool_button("delete", "Delete the bookmark", self.delete_current)
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
        QShortcut(
            Qt.Key.Key_Delete, self._list, self.delete_current, context=Qt.ShortcutContext.WidgetShortcut
        )
        self._link.frame_shown.connect(self._update_buttons)
        self._bookmarks.changed.connect(self._refresh)
        self._bookmarks.failed.connect(self._show_error)

    def go_to(self, index: int) -> None:
        """Go to the viewpoint of a bookmark if it exists."""
        if 0 <= index < len(self._bookmarks.all):
            bookmark = self._bookmarks.all[index]
            self._link.change_view(mode=bookmark.mode)
            self._link.send(Look(bookmark.pose))
            self._list.setCurrentRow(index)

    def add(self) -> None:
        """Add the current view, if there is a picture."""
        bookmark = self._current_view(self._bookmarks.free_name())
        if bookmark is not None:
            self._bookmarks.add(bookmark)
            self._list.setCurrentRow(len(self._bookmarks.all) - 1)

    def replace_current(self) -> None:
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
