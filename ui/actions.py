"""The declared commands as Qt's actions: made once, bound to what they do, shown in menus and tool bars."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from PyQt6.QtCore import QObject
from PyQt6.QtGui import QAction, QActionGroup, QKeySequence
from PyQt6.QtWidgets import QMainWindow

from sketchterrain.ui.action_list import COMMANDS
from sketchterrain.ui.look.icons import icon

_GROUPS = ("tool", "layer", "mode")


class Actions(QObject):
    """All actions of a window, by the names in `COMMANDS`."""

    def __init__(self, window: QMainWindow, names: Iterable[str] = COMMANDS) -> None:
        super().__init__(window)
        groups = {kind: QActionGroup(self) for kind in _GROUPS}
        self._actions: dict[str, QAction] = {}
        self._plain: dict[str, Callable[[], object]] = {}
        self._checked: dict[str, Callable[[bool], object]] = {}
        for name in names:
            command = COMMANDS[name]
            action = QAction(command.text, self)
            action.setObjectName(name)
            action.setShortcuts([QKeySequence(key) for key in command.keys])
            action.setStatusTip(command.tip)
            action.setToolTip(_tool_tip(command.text, command.tip, action))
            if command.icon:
                action.setIcon(icon(command.icon))
            action.setCheckable(bool(command.kind))
            action.setIconVisibleInMenu(not command.kind)  # there the tick says more
            if command.kind in groups:
                groups[command.kind].addAction(action)
            action.triggered.connect(self._do)
            self._actions[name] = action
            window.addAction(action)

    def __getitem__(self, name: str) -> QAction:
        return self._actions[name]

    def __contains__(self, name: object) -> bool:
        return name in self._actions

    def __iter__(self) -> Iterator[QAction]:
        return iter(self._actions.values())

    def bind(self, what: Mapping[str, Callable[[], object]]) -> None:
        """Say what actions do when they are triggered."""
        for name, do in what.items():
            self._actions[name]  # a name that is none is told now, not when it is chosen
            self._plain[name] = do

    def bind_checked(self, what: Mapping[str, Callable[[bool], object]]) -> None:
        """Say what actions do when a person switches them on or off."""
        for name, do in what.items():
            self._actions[name]
            self._checked[name] = do

    def _do(self, on: bool) -> None:
        # One bound method for all: it is let go in order when the window is deleted.
        action = self.sender()
        name = "" if action is None else action.objectName()
        if name in self._plain:
            self._plain[name]()
        elif name in self._checked:
            self._checked[name](on)


def _tool_tip(text: str, tip: str, action: QAction) -> str:
    keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
    title = text.replace("&", "").rstrip("…")
    return f"<p><b>{title}</b>{f' &nbsp;{keys}' if keys else ''}<br>{tip}</p>"
