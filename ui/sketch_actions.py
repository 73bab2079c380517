"""The menus Edit, Layer and Terrain at work: what their actions do to the sketch, and when they can."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial

from PyQt6.QtCore import QObject

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.banner import Banner, Message
from sketchterrain.ui.commands import placed_edits
from sketchterrain.ui.commands.labels import labels_of
from sketchterrain.ui.commands.placed_edits import exists, find_point
from sketchterrain.ui.commands.settings import WORLD, set_setting
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models.chosen_acts import delete, lock, reset, unlock
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import TOOLS, Selection, Workspace

_STEP = 1.25  # by which the brush grows
_SEEDS = 1_000_000  # short enough to be told to a friend


class SketchActions(QObject):
    """Binds actions to commands on the sketch, and keeps them as enabled and checked as it is."""

    def __init__(
        self, actions: Actions, document: Document, workspace: Workspace, link: EngineLink, banner: Banner
    ) -> None:
        super().__init__(actions)
        self._actions = actions
        self._document = document
        self._workspace = workspace
        self._link = link
        self._banner = banner
        self._hidden: tuple[str, ...] = ()  # by "only this layer"
        actions.bind(
            {
                "undo": document.undo,
                "redo": document.redo,
                "delete-chosen": partial(self._act, delete),
                "reset-chosen": partial(self._act, reset),
                "choose-none": self._choose_none,
                "brush-smaller": partial(self._scale_brush, 1.0 / _STEP),
                "brush-larger": partial(self._scale_brush, _STEP),
                "random-seed": self.random_seed,
                **{f"tool-{name}": partial(setattr, workspace, "tool", name) for name in TOOLS},
                **{f"layer-{name}": partial(self._use_layer, name) for name in LAYERS},
            }
        )
        actions.bind_checked(
            {
                "lock-chosen": self._lock_chosen,
                "show-layer": lambda on: workspace.set_look(workspace.layer, visible=on),
                "lock-layer": lambda on: workspace.set_look(workspace.layer, locked=on),
                "only-layer": self._show_only,
            }
        )
        for signal in (document.history_changed, document.sketch_changed, document.opened):
            signal.connect(self.refresh)
        for signal in (workspace.tool_changed, workspace.label_changed, workspace.look_changed):
            signal.connect(self.refresh)
        for signal in (workspace.selection_changed, link.placed_changed):
            signal.connect(self.refresh)
        self.refresh()

    def refresh(self, *_: object) -> None:
        """Show what can be done now."""
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
        others = [name for name in LAYERS if name != workspace.layer]
        actions["only-layer"].setChecked(
            look.visible and not any(workspace.look(each).visible for each in others)
        )
        self._refresh_chosen()

    def random_seed(self) -> None:
        """Make another terrain of the same sketch."""
        thrown = random.randrange(_SEEDS - 1)  # noqa: S311 - a terrain, no secret
        seed = thrown + (thrown >= self._document.sketch.seed)  # never the one that it has
        sketch = self._document.sketch
        self._try(lambda: self._document.do(f"Seed {seed}", set_setting(sketch, WORLD, "seed", seed)))

    def _refresh_chosen(self) -> None:
        selection, placed = self._workspace.selection, self._link.placed
        there = selection is not None and placed is not None and exists(placed, selection)
        self._actions["choose-none"].setEnabled(selection is not None)
        self._actions["delete-chosen"].setEnabled(there)
        self._actions["look-chosen"].setEnabled(there)
        can_lock = there and find_point(placed, selection) is not None if placed and selection else False
        self._actions["lock-chosen"].setEnabled(can_lock)
        sketch = self._document.sketch
        locked = selection is not None and placed_edits.is_locked(sketch, selection)
        self._actions["lock-chosen"].setChecked(can_lock and locked)
        edited = bool(there and placed and selection and placed_edits.is_edited(sketch, placed, selection))
        self._actions["reset-chosen"].setEnabled(edited)

    def _try(self, change: Callable[[], None]) -> None:
        try:
            change()
        except InputError as error:
            self._banner.tell(Message("warning", str(error), "command"))

    def _act(self, act: Callable[[Document, Workspace, Placement, Selection], None]) -> None:
        selection, placed = self._workspace.selection, self._link.placed
        if selection is not None and placed is not None:
            self._try(lambda: act(self._document, self._workspace, placed, selection))
            self.refresh()

    def _lock_chosen(self, on: bool) -> None:
        self._act(lock if on else unlock)

    def _choose_none(self) -> None:
        self._workspace.selection = None

    def _scale_brush(self, factor: float) -> None:
        self._workspace.brush *= factor

    def _use_layer(self, layer: str) -> None:
        if layer != self._workspace.layer:
            labels = labels_of(self._document.sketch, layer)
            self._workspace.use_label(layer, labels[0] if labels else 1)

    def _show_only(self, on: bool) -> None:
        others = [name for name in LAYERS if name != self._workspace.layer]
        if on:
            self._hidden = tuple(name for name in others if self._workspace.look(name).visible)
            self._workspace.set_look(self._workspace.layer, visible=True)
            for name in others:
                self._workspace.set_look(name, visible=False)
        else:
            for name in self._hidden or others:
                self._workspace.set_look(name, visible=True)
        self.refresh()
