"""What stands in which menu and in the tool bar, in which order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from PyQt6.QtCore import QSize, Qt
from PyQt6.QtWidgets import QMainWindow, QMenu, QToolBar

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.models.workspace import OVERLAYS, TOOLS

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
