"""The menu View and the eye's part of the menu Terrain at work: what is shown, and from where."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from PyQt6.QtCore import QObject

from sketchterrain.ui.engine.orders import MODES, MeasureAdherence
from sketchterrain.ui.models.workspace import OVERLAYS

if TYPE_CHECKING:
    from sketchterrain.ui.actions import Actions
    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.models.workspace import Workspace

__all__ = ["ViewActions"]


class ViewActions(QObject):
    """Binds actions to the workspace's overlays and the engine's view, and shows how these are.

    Parameters
    ----------
    actions, workspace, link
    """

    def __init__(self, actions: Actions, workspace: Workspace, link: EngineLink) -> None:
        super().__init__(actions)
        self._actions = actions
        self._workspace = workspace
        self._link = link
        actions.bind(
            {
                "measure": self._measure,
                **{f"mode-{mode}": partial(self._move_by, mode) for mode in MODES},
            }
        )
        actions.bind_checked(
            {
                "play": lambda on: link.show(replace(link.view, plays=on)),
                **{f"overlay-{name}": partial(workspace.show_overlay, name) for name in OVERLAYS},
            }
        )
        workspace.overlays_changed.connect(self.refresh)
        link.view_changed.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        """Show what is shown now."""
        for name in OVERLAYS:
            self._actions[f"overlay-{name}"].setChecked(name in self._workspace.overlays)
        self._actions[f"mode-{self._link.view.mode}"].setChecked(True)
        self._actions["play"].setChecked(self._link.view.plays)

    def _move_by(self, mode: str) -> None:
        self._link.show(replace(self._link.view, mode=mode))

    def _measure(self) -> None:
        self._workspace.show_overlay("adherence", True)
        self._link.tell(MeasureAdherence())
