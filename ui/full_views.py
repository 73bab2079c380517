"""One part of the window alone, or the whole screen, and the way back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtCore import QObject

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QMainWindow

    from sketchterrain.ui.actions import Actions
    from sketchterrain.ui.layout import Layout

__all__ = ["FullViews"]


class FullViews(QObject):
    """Binds the actions that make something large, and shows which of them is on.

    Parameters
    ----------
    window, actions, layout
    """

    def __init__(self, window: QMainWindow, actions: Actions, layout: Layout) -> None:
        super().__init__(window)
        self._window, self._actions, self._layout = window, actions, layout
        self._was_maximised = False
        actions.bind({"leave": self.leave, "reset-layout": self._reset})
        actions.bind_checked(
            {
                "canvas-only": lambda on: self.show_alone("canvas" if on else ""),
                "view-only": lambda on: self.show_alone("view" if on else ""),
                "full-screen": self.fill_screen,
            }
        )
        self._refresh()

    def show_alone(self, part: str) -> None:
        """Give the window to ``canvas`` or ``view``; empty: to all as before."""
        self._layout.show_alone(part)
        self._refresh()

    def fill_screen(self, on: bool) -> None:
        """Use the whole screen, or go back to how the window was."""
        if on:
            self._was_maximised = self._window.isMaximized()
            self._window.showFullScreen()
        elif self._was_maximised:
            self._window.showMaximized()
        else:
            self._window.showNormal()
        self._refresh()

    def leave(self) -> None:
        """Go back by one step."""
        if self._layout.alone:
            self.show_alone("")
        else:
            self.fill_screen(False)

    def _reset(self) -> None:
        self._layout.reset()
        self._refresh()

    def _refresh(self) -> None:
        alone, actions = self._layout.alone, self._actions
        actions["canvas-only"].setChecked(alone == "canvas")
        actions["view-only"].setChecked(alone == "view")
        actions["full-screen"].setChecked(self._window.isFullScreen())
        # Esc is others' as long as there is nothing to leave.
        actions["leave"].setEnabled(bool(alone) or self._window.isFullScreen())
