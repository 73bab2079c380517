"""What keys do while the view has them: they move the eye, or are commands of the view."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QEvent, QObject, Qt
from PyQt6.QtGui import QKeyEvent

from sketchterrain.ui.engine.orders import MODES
from sketchterrain.ui.view3d.motion import FLYING_KEYS, Keys

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.models.workspace import Workspace
    from sketchterrain.ui.view3d.mouse import Mouse

__all__ = ["Keyboard"]

_Key = Qt.Key
_Modifier = Qt.KeyboardModifier
_MODE_KEYS: Final = dict(zip((_Key.Key_1, _Key.Key_2, _Key.Key_3), MODES, strict=True))
_OTHERS: Final = _Modifier.ControlModifier | _Modifier.AltModifier | _Modifier.MetaModifier


class Keyboard(QObject):
    """Follows keys.

    It looks at the view's events as a filter: a widget that handles all of its events in Python is still in
    Python when it is deleted, which Qt's bindings do not always survive.

    Parameters
    ----------
    view
        Whose keys these are.
    link, workspace, mouse
    commands
        What a key does.
    """

    def __init__(
        self,
        view: QWidget,
        link: EngineLink,
        workspace: Workspace,
        mouse: Mouse,
        commands: Mapping[int, Callable[[], None]],
    ) -> None:
        super().__init__(view)
        self._link, self._workspace, self._mouse = link, workspace, mouse
        self._commands = commands
        self._keys = Keys()
        view.installEventFilter(self)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        """Keep the view's keys from being shortcuts of the window."""
        if (
            isinstance(event, QKeyEvent)
            and event.type() == QEvent.Type.ShortcutOverride
            and self.is_own(event)
        ):
            event.accept()
            return True
        return False

    def is_own(self, event: QKeyEvent) -> bool:
        """Whether a key is the view's now; others are the window's."""
        if event.modifiers() & _OTHERS:
            return False
        if event.key() == _Key.Key_Escape:
            return self._mouse.drags or self._workspace.chosen is not None
        return event.key() in FLYING_KEYS or event.key() in _MODE_KEYS or event.key() in self._commands

    def press(self, event: QKeyEvent) -> bool:
        """Do what a key says; return whether it was the view's."""
        key = event.key()
        if not self.is_own(event):
            if key == _Key.Key_Shift:
                self._tell(self._keys.hurry(quick=True))
            return False
        if event.isAutoRepeat():
            return True
        if key in FLYING_KEYS:
            self._tell(self._keys.press(key))
        elif key in _MODE_KEYS:
            self._link.show(replace(self._link.view, mode=_MODE_KEYS[_Key(key)]))
        elif key in self._commands:
            self._commands[key]()
        elif not self._mouse.cancel():
            self._workspace.chosen = None
        return True

    def release(self, event: QKeyEvent) -> None:
        """Let a key go."""
        if event.isAutoRepeat():
            return
        if event.key() == _Key.Key_Shift:
            self._tell(self._keys.hurry(quick=False))
        self._tell(self._keys.release(event.key()))

    def let_go(self) -> None:
        """Let all keys go: their release is seen elsewhere."""
        self._tell(self._keys.let_go())

    def _tell(self, motion: object | None) -> None:
        if motion is not None:
            self._link.tell(motion)
