"""Actions of the 3-D view: navigation mode, animation and overlays."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from PyQt6.QtCore import QObject

from sketchterrain.ui.actions import Actions
from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.engine.protocol import MODES, MeasureAdherence
from sketchterrain.ui.models.workspace import OVERLAYS, Workspace


class ViewActions(QObject):
    """Binds actions to a source's view and, for a sketch, to the workspace's overlays."""

    def __init__(self, actions: Actions, link: ViewSource, workspace: Workspace | None = None) -> None:
        super().__init__(actions)
        self._actions, self._link, self._workspace = actions, link, workspace
        actions.bind({f"mode-{mode}": partial(self._set_mode, mode) for mode in MODES})
        actions.bind_checked({"play": lambda on: link.set_view(replace(link.view, plays=on))})
        if workspace is not None:
            actions.bind({"measure": partial(self._measure, workspace)})
            actions.bind_checked(
                {f"overlay-{name}": partial(workspace.show_overlay, name) for name in OVERLAYS}
            )
            workspace.overlays_changed.connect(self.refresh)
        link.view_changed.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        """Update which actions are checked."""
        if self._workspace is not None:
            for name in OVERLAYS:
                self._actions[f"overlay-{name}"].setChecked(name in self._workspace.overlays)
        self._actions[f"mode-{self._link.view.mode}"].setChecked(True)
        self._actions["play"].setChecked(self._link.view.plays)

    def _set_mode(self, mode: str) -> None:
        self._link.set_view(replace(self._link.view, mode=mode))

    def _measure(self, workspace: Workspace) -> None:
        workspace.show_overlay("adherence", True)
        self._link.send(MeasureAdherence())
