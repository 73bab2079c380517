"""A menu of things that are done at once, for a place or for what is chosen."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from PyQt6.QtCore import Qt
from PyQt6.QtGui import QAction
from PyQt6.QtWidgets import QMenu, QWidget

from sketchterrain.ui.commands.chosen_parts import name_of
from sketchterrain.ui.commands.placed_edits import is_edited, is_locked
from sketchterrain.ui.engine.protocol import Placed
from sketchterrain.ui.look.icons import icon
from sketchterrain.ui.models.chosen_acts import delete, lock, reset, unlock
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Chosen, Workspace


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
    menu: DoingMenu, document: Document, workspace: Workspace, placed: Placed, chosen: Chosen
) -> None:
    """Add what can be done with a feature, a river or a lake."""
    name, sketch = name_of(placed, chosen), document.sketch
    acts: dict[str, Callable[..., None]] = {"reset": reset, "delete": delete}
    if chosen.kind == "feature":
        acts = ({"unlock": unlock} if is_locked(sketch, chosen) else {"lock": lock}) | acts
    for verb, act in acts.items():
        do = partial(act, document, workspace, placed, chosen)
        action = menu.offer(verb, f"{verb.capitalize()} {name}", do)
        action.setEnabled(verb != "reset" or is_edited(sketch, placed, chosen))
