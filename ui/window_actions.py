"""Actions of the main window on the sketch and the view."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from PyQt6.QtCore import QObject

from sketchterrain.document.parameters import LAYERS
from sketchterrain.errors import InputError
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.banner import Banner, Message
from sketchterrain.ui.commands import (
    WORLD,
    exists,
    find_point,
    is_edited,
    is_locked,
    labels_of,
    random_seed,
    set_setting,
)
from sketchterrain.ui.engine.link import EngineLink, ViewSource
from sketchterrain.ui.engine.protocol import MODES, MeasureAdherence, Placement
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import OVERLAYS, TOOLS, Selection, Workspace


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


_BRUSH_STEP = 1.25


class SketchActions(QObject):
    """Binds actions to commands on the sketch and updates their state."""

    def __init__(
        self, actions: Actions, document: Document, workspace: Workspace, link: EngineLink, banner: Banner
    ) -> None:
        super().__init__(actions)
        self._actions, self._banner = actions, banner
        self._document, self._workspace, self._link = document, workspace, link
        self._hidden: tuple[str, ...] = ()  # layers hidden by "only this layer"
        actions.bind(
            {
                "undo": document.undo,
                "redo": document.redo,
                "delete-selection": partial(self._apply, delete),
                "reset-selection": partial(self._apply, reset),
                "select-none": partial(setattr, workspace, "selection", None),
                "brush-smaller": partial(self._scale_brush, 1.0 / _BRUSH_STEP),
                "brush-larger": partial(self._scale_brush, _BRUSH_STEP),
                "random-seed": self.set_random_seed,
                **{f"tool-{name}": partial(setattr, workspace, "tool", name) for name in TOOLS},
                **{f"layer-{name}": partial(self._use_layer, name) for name in LAYERS},
            }
        )
        actions.bind_checked(
            {
                "lock-selection": lambda on: self._apply(lock if on else unlock),
                "show-layer": lambda on: workspace.set_look(workspace.layer, visible=on),
                "lock-layer": lambda on: workspace.set_look(workspace.layer, locked=on),
                "only-layer": self._show_only,
            }
        )
        for signal in (
            *(document.history_changed, document.sketch_changed, document.opened, link.placed_changed),
            *(workspace.tool_changed, workspace.label_changed, workspace.look_changed),
            workspace.selection_changed,
        ):
            signal.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        """Update texts, enabled and checked states."""
        actions, history, workspace = self._actions, self._document.history, self._workspace
        actions["undo"].setEnabled(history.position > 0)
        actions["redo"].setEnabled(history.position < len(history.titles) - 1)
        undone = history.titles[history.position] if history.position > 0 else ""
        redone = history.titles[history.position + 1] if actions["redo"].isEnabled() else ""
        actions["undo"].setText(f"&Undo {undone[:1].lower()}{undone[1:]}".rstrip())
        actions["redo"].setText(f"&Redo {redone[:1].lower()}{redone[1:]}".rstrip())
        actions[f"tool-{workspace.tool}"].setChecked(True)
        actions[f"layer-{workspace.layer}"].setChecked(True)
        look = workspace.look(workspace.layer)
        actions["show-layer"].setChecked(look.visible)
        actions["lock-layer"].setChecked(look.locked)
        others_visible = any(workspace.look(each).visible for each in self._other_layers())
        actions["only-layer"].setChecked(look.visible and not others_visible)
        self._refresh_selection()

    def set_random_seed(self) -> None:
        sketch = self._document.sketch
        seed = random_seed(sketch.seed)
        self._try(lambda: self._document.do(f"Seed {seed}", set_setting(sketch, WORLD, "seed", seed)))

    def _refresh_selection(self) -> None:
        selection, placed, sketch = self._workspace.selection, self._link.placed, self._document.sketch
        is_placed = can_lock = locked = edited = False
        if selection is not None and placed is not None and exists(placed, selection):
            is_placed = True
            can_lock = find_point(placed, selection) is not None
            locked = can_lock and is_locked(sketch, selection)
            edited = is_edited(sketch, placed, selection)
        for name, enabled in (
            ("select-none", selection is not None),
            ("delete-selection", is_placed),
            ("look-selection", is_placed),
            ("lock-selection", can_lock),
            ("reset-selection", edited),
        ):
            self._actions[name].setEnabled(enabled)
        self._actions["lock-selection"].setChecked(locked)

    def _try(self, change: Callable[[], None]) -> None:
        try:
            change()
        except InputError as error:
            self._banner.show_message(Message("warning", str(error), "command"))

    def _apply(self, command: Callable[[Document, Workspace, Placement, Selection], None]) -> None:
        selection, placed = self._workspace.selection, self._link.placed
        if selection is not None and placed is not None:
            self._try(lambda: command(self._document, self._workspace, placed, selection))
            self.refresh()

    def _scale_brush(self, factor: float) -> None:
        self._workspace.brush *= factor

    def _use_layer(self, layer: str) -> None:
        if layer != self._workspace.layer:
            labels = labels_of(self._document.sketch, layer)
            self._workspace.use_label(layer, labels[0] if labels else 1)

    def _other_layers(self) -> list[str]:
        return [name for name in LAYERS if name != self._workspace.layer]

    def _show_only(self, on: bool) -> None:
        others = self._other_layers()
        if on:
            self._hidden = tuple(name for name in others if self._workspace.look(name).visible)
            self._workspace.set_look(self._workspace.layer, visible=True)
        for name in others if on else self._hidden or others:
            self._workspace.set_look(name, visible=not on)
        self.refresh()
