"""Menus and tool bars: what stands where, recent files, context menus."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from PyQt6.QtCore import QSize, Qt
from PyQt6.QtGui import QAction
from PyQt6.QtWidgets import QMainWindow, QMenu, QToolBar, QWidget

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.commands.placed_edits import is_edited, is_locked, name_of
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.files import Files
from sketchterrain.ui.look.icons import icon
from sketchterrain.ui.models.chosen_acts import delete, lock, reset, unlock
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.preferences import RecentFiles
from sketchterrain.ui.models.workspace import OVERLAYS, TOOLS, Selection, Workspace


class DoingMenu(QMenu):
    """A menu that is gone once it is closed, and does what was chosen."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._dos: dict[str, Callable[[], object]] = {}
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.triggered.connect(self._do)

    def offer(self, name: str, text: str, do: Callable[[], object]) -> QAction:
        """Add something to do, with an icon of `ui.look.icons` or, for an empty name, none."""
        action = QAction(text, self)
        if name:
            action.setIcon(icon(name))
        self._dos[text] = do
        self.addAction(action)
        return action

    def within(self, name: str, text: str) -> DoingMenu:
        """Add a menu that opens beside this one; it goes with this one."""
        inner = DoingMenu(self)
        inner.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
        inner.setIcon(icon(name))
        inner.setTitle(text)
        self.addMenu(inner)
        return inner

    def _do(self, action: QAction) -> None:
        do = self._dos.get(action.text())
        if do is not None:  # else it is of a menu within, which does it
            do()


def offer_chosen(
    menu: DoingMenu, document: Document, workspace: Workspace, placed: Placement, selection: Selection
) -> None:
    """Add what can be done with a feature, a river or a lake."""
    name, sketch = name_of(placed, selection), document.sketch
    acts: dict[str, Callable[..., None]] = {"reset": reset, "delete": delete}
    if selection.kind == "feature":
        acts = ({"unlock": unlock} if is_locked(sketch, selection) else {"lock": lock}) | acts
    for verb, act in acts.items():
        do = partial(act, document, workspace, placed, selection)
        action = menu.offer(verb, f"{verb.capitalize()} {name}", do)
        action.setEnabled(verb != "reset" or is_edited(sketch, placed, selection))


class RecentMenu(QMenu):
    """Opens what was open before."""

    def __init__(self, recent: RecentFiles, files: Files, parent: QWidget) -> None:
        super().__init__("Open &recent", parent)
        self._recent, self._files = recent, files
        recent.changed.connect(self._fill)
        self._fill()

    def _fill(self) -> None:
        self.clear()
        for number, path in enumerate(self._recent.paths, start=1):
            mark = f"&{number} " if number < 10 else ""
            action = self.addAction(f"{mark}{_short(path)}")
            if action is not None:
                action.setStatusTip(f"Open {path}")
                action.triggered.connect(partial(self._open, path))
        self.addSeparator()
        forget = self.addAction("&Forget these")
        if forget is not None:
            forget.setStatusTip("Empty this list")
            forget.triggered.connect(self._recent.clear)
        self.setEnabled(bool(self._recent.paths))

    def _open(self, path: Path, _: bool = False) -> None:
        self._files.open(path)


def _short(path: Path) -> str:
    """Return a path with ``~`` for the home folder; an ampersand in it marks no key."""
    home = Path.home()
    shown = f"~/{path.relative_to(home)}" if path.is_relative_to(home) else str(path)
    return shown.replace("&", "&&")


_RULE = "-"
_TOOLS = tuple(f"tool-{name}" for name in TOOLS)
_MODES = ("mode-orbit", "mode-fly", "mode-walk")

MENUS: Final[dict[str, tuple[str, ...]]] = {
    "&File": (
        *("new", "trace", "open", "open-folder", "open-world", ">Open &recent", "presets", _RULE),
        *("save", "save-as", _RULE, "import", "export", "write-world", "save-picture", _RULE, "quit"),
    ),
    "&Edit": (
        *("undo", "redo", _RULE, ">&Tool", "brush-smaller", "brush-larger", _RULE, "delete-chosen"),
        *("lock-chosen", "reset-chosen", "choose-none", _RULE, "preferences"),
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
        *(
            "random-seed",
            "measure",
            _RULE,
            *_MODES,
            "look-all",
            "look-best",
            "look-chosen",
            _RULE,
            "bookmark",
        ),
        *(">Go to &view", _RULE, "play", "restart"),
    ),
    "&Help": ("first-steps", "keys", "find", _RULE, "about"),
}
"""Names of actions; ``-`` is a line, ``>Title`` a menu of its own."""

_BAR = ("new", "open", "save", _RULE, "undo", "redo", _RULE, "export", "save-picture")
_VIEW_BAR = ("random-seed", "measure", _RULE, "canvas-only", "view-only", "full-screen")


def add_menus(window: QMainWindow, actions: Actions, inner: Mapping[str, QMenu]) -> None:
    """Fill a window's menu bar."""
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
            elif name[1:] in inner:
                menu.addMenu(inner[name[1:]])
            elif name in actions:
                menu.addAction(actions[name])


def add_tool_bars(window: QMainWindow, actions: Actions) -> tuple[QToolBar, QToolBar]:
    """Give a window its bar of commands at the top and its bar of tools at the left; return both."""
    commands, tools = QToolBar("Commands", window), QToolBar("Tools", window)
    _fill(commands, actions, _BAR)
    _fill(tools, actions, _TOOLS)
    for bar, name in ((commands, "commands"), (tools, "tools")):
        bar.setObjectName(f"bar-{name}")
        bar.setIconSize(QSize(20, 20))
        bar.setMovable(False)
        bar.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonIconOnly)
    window.addToolBar(Qt.ToolBarArea.TopToolBarArea, commands)
    window.addToolBar(Qt.ToolBarArea.LeftToolBarArea, tools)
    return commands, tools


def add_last(bar: QToolBar, actions: Actions) -> None:
    """Add what stands at the right end of the bar of commands."""
    _fill(bar, actions, _VIEW_BAR)


def _fill(bar: QToolBar, actions: Actions, names: Iterable[str]) -> None:
    for name in names:
        if name == _RULE:
            bar.addSeparator()
        else:
            bar.addAction(actions[name])
