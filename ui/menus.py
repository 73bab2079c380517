"""Menus, tool bars and context menus."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from PyQt6.QtCore import QSize, Qt
from PyQt6.QtGui import QAction
from PyQt6.QtWidgets import QMainWindow, QMenu, QToolBar, QWidget

from sketchterrain.document.layers import LAYERS
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.commands import is_edited, is_locked, name_of
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.files import Files
from sketchterrain.ui.look.theme import icon
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import OVERLAYS, TOOLS, RecentFiles, Selection, Workspace


class ContextMenu(QMenu):
    """A menu that is deleted when it closes."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._callbacks: dict[str, Callable[[], object]] = {}
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.triggered.connect(self._run)

    def add_command(self, icon_name: str, text: str, callback: Callable[[], object]) -> QAction:
        """Add an action, with an icon of `ui.look.icons` unless its name is empty."""
        action = QAction(text, self)
        if icon_name:
            action.setIcon(icon(icon_name))
        self._callbacks[text] = callback
        self.addAction(action)
        return action

    def add_submenu(self, icon_name: str, text: str) -> ContextMenu:
        """Add a submenu, deleted with this menu."""
        inner = ContextMenu(self)
        inner.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
        inner.setIcon(icon(icon_name))
        inner.setTitle(text)
        self.addMenu(inner)
        return inner

    def _run(self, action: QAction) -> None:
        callback = self._callbacks.get(action.text())
        if callback is not None:  # else an action of a submenu, which runs it
            callback()


def add_selection_commands(
    menu: ContextMenu, document: Document, workspace: Workspace, placed: Placement, selection: Selection
) -> None:
    """Add the commands for a feature, a river or a lake to a menu."""
    name, sketch = name_of(placed, selection), document.sketch
    commands: dict[str, Callable[..., None]] = {"reset": reset, "delete": delete}
    if selection.kind == "feature":
        commands = ({"unlock": unlock} if is_locked(sketch, selection) else {"lock": lock}) | commands
    for verb, command in commands.items():
        callback = partial(command, document, workspace, placed, selection)
        action = menu.add_command(verb, f"{verb.capitalize()} {name}", callback)
        action.setEnabled(verb != "reset" or is_edited(sketch, placed, selection))


class RecentMenu(QMenu):
    """Menu of recently opened files."""

    def __init__(self, recent: RecentFiles, files: Files, parent: QWidget) -> None:
        super().__init__("Open &recent", parent)
        self._recent, self._files = recent, files
        recent.changed.connect(self._fill)
        self._fill()

    def _fill(self) -> None:
        self.clear()
        for number, path in enumerate(self._recent.paths, start=1):
            mnemonic = f"&{number} " if number < 10 else ""
            action = self.addAction(f"{mnemonic}{_short(path)}")
            if action is not None:
                action.setStatusTip(f"Open {path}")
                action.triggered.connect(partial(self._open, path))
        self.addSeparator()
        clear = self.addAction("&Clear list")
        if clear is not None:
            clear.setStatusTip("Empty this list")
            clear.triggered.connect(self._recent.clear)
        self.setEnabled(bool(self._recent.paths))

    def _open(self, path: Path, _: bool = False) -> None:
        self._files.open(path)


def _short(path: Path) -> str:
    """Return a path with ``~`` for the home folder and ampersands escaped for menus."""
    home = Path.home()
    text = f"~/{path.relative_to(home)}" if path.is_relative_to(home) else str(path)
    return text.replace("&", "&&")


_RULE = "-"
_MODES = ("mode-orbit", "mode-fly", "mode-walk")
_LOOKS = ("look-all", "look-best", "look-selection")

MENUS: Final[dict[str, tuple[str, ...]]] = {
    "&File": (
        *("new", "trace", "open", "open-folder", "open-world", ">Open &recent", "presets", _RULE),
        *("save", "save-as", _RULE, "import", "export", "write-world", "save-picture", _RULE, "quit"),
    ),
    "&Edit": (
        *("undo", "redo", _RULE, ">&Tool", "brush-smaller", "brush-larger", _RULE, "delete-selection"),
        *("lock-selection", "reset-selection", "select-none", _RULE, "preferences"),
    ),
    "&Layer": (
        *(f"layer-{name}" for name in LAYERS),
        *(_RULE, "new-label", "delete-label", "clear-layer", _RULE, "show-layer", "lock-layer", "only-layer"),
    ),
    "&View": (
        *("fit", "zoom-in", "zoom-out", "actual-size", _RULE, *(f"overlay-{name}" for name in OVERLAYS)),
        *(_RULE, "canvas-only", "view-only", "full-screen", _RULE, ">&Panels", "reset-layout"),
    ),
    "&Terrain": (
        *("random-seed", "measure", _RULE, *_MODES, *_LOOKS, _RULE, "bookmark"),
        *(">Go to &view", _RULE, "play", "restart"),
    ),
    "&Help": ("first-steps", "keys", "find", _RULE, "about"),
}
"""Names of actions; ``-`` is a separator, ``>Title`` a submenu."""

_BAR = ("new", "open", "save", _RULE, "undo", "redo", _RULE, "export", "save-picture")
_BAR_END = ("random-seed", "measure", _RULE, "canvas-only", "view-only", "full-screen")


def add_menus(window: QMainWindow, actions: Actions, submenus: Mapping[str, QMenu]) -> None:
    """Fill a window's menu bar with those actions of `MENUS` that it has."""
    bar = window.menuBar()
    if bar is None:
        return
    for title, names in MENUS.items():
        if not any(name in actions for name in names):
            continue
        menu = QMenu(title, window)
        menu.setToolTipsVisible(False)
        bar.addMenu(menu)
        for name in names:
            if name == _RULE:
                menu.addSeparator()
            elif name[1:] in submenus:
                menu.addMenu(submenus[name[1:]])
            elif name in actions:
                menu.addAction(actions[name])


def add_tool_bars(window: QMainWindow, actions: Actions, options: Iterable[QWidget]) -> QToolBar:
    """Add the bar of tools and the bar of commands, with `options` in its middle; return the latter."""
    commands, tools = QToolBar("Commands", window), QToolBar("Tools", window)
    _fill(commands, actions, _BAR)
    commands.addSeparator()
    for widget in options:
        commands.addWidget(widget)
    _fill(commands, actions, _BAR_END)
    _fill(tools, actions, (f"tool-{name}" for name in TOOLS))
    for bar, name in ((commands, "commands"), (tools, "tools")):
        bar.setObjectName(f"bar-{name}")
        bar.setIconSize(QSize(20, 20))
        bar.setMovable(False)
        bar.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonIconOnly)
    window.addToolBar(Qt.ToolBarArea.TopToolBarArea, commands)
    window.addToolBar(Qt.ToolBarArea.LeftToolBarArea, tools)
    return commands


def _fill(bar: QToolBar, actions: Actions, names: Iterable[str]) -> None:
    for name in names:
        if name == _RULE:
            bar.addSeparator()
        else:
            bar.addAction(actions[name])
