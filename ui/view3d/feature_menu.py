"""The menu of a place of the terrain: of what stands there, and what could be added."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from PyQt6.QtCore import Qt
from PyQt6.QtGui import QAction
from PyQt6.QtWidgets import QMenu, QWidget

from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.ui.commands.chosen_parts import is_there, name_of
from sketchterrain.ui.commands.placed_edits import (
    added_at,
    deleted,
    is_edited,
    is_locked,
    locked,
    reset,
    unlocked,
)
from sketchterrain.ui.look.icons import icon
from sketchterrain.ui.models.workspace import Chosen

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.ui.engine.messages import Placed
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.workspace import Workspace

__all__ = ["DoingMenu", "add", "delete", "delete_or_reset", "feature_menu"]


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

    def _do(self, action: QAction) -> None:
        self._dos[action.text()]()


def feature_menu(
    parent: QWidget,
    document: Document,
    workspace: Workspace,
    placed: Placed,
    *,
    chosen: Chosen | None,
    place: tuple[float, float] | None,
) -> DoingMenu:
    """Return the menu of a place.

    Parameters
    ----------
    parent
    document, workspace, placed
    chosen
        What stands there.
    place
        Where it is (m); None in the sky, where nothing can be added.
    """
    menu = DoingMenu(parent)
    if chosen is not None and is_there(placed, chosen):
        _add_own(menu, document, workspace, placed, chosen)
    if place is not None:
        menu.addSeparator()
        x, y = place
        for kind in FEATURE_TYPES:
            menu.offer("add", f"Add {kind} here", partial(add, document, workspace, kind, x, y))
    return menu


def add(document: Document, workspace: Workspace, kind: str, x: float, y: float) -> None:
    """Add a feature at a place (m), and select it."""
    sketch = added_at(document.sketch, kind, x, y)
    document.do(f"Add {kind}", sketch)
    workspace.chosen = Chosen("feature", sketch.edits[-1].feature or 0)


def _add_own(
    menu: DoingMenu, document: Document, workspace: Workspace, placed: Placed, chosen: Chosen
) -> None:
    name, sketch = name_of(placed, chosen), document.sketch
    if chosen.kind == "feature":
        word, other = (
            ("Unlock", unlocked(sketch, chosen))
            if is_locked(sketch, chosen)
            else ("Lock", locked(sketch, placed, chosen))
        )
        menu.offer(word.lower(), f"{word} {name}", partial(document.do, f"{word} {name}", other))
    again = reset(sketch, placed, chosen)
    action = menu.offer("reset", f"Reset {name}", partial(document.do, f"Reset {name}", again))
    action.setEnabled(again is not sketch)
    menu.offer("delete", f"Delete {name}", partial(delete, document, workspace, placed, chosen))


def delete(document: Document, workspace: Workspace, placed: Placed, chosen: Chosen) -> None:
    """Delete a feature, a river or a lake, and let go of it."""
    document.do(f"Delete {name_of(placed, chosen)}", deleted(document.sketch, chosen))
    workspace.chosen = None


def delete_or_reset(document: Document, workspace: Workspace, placed: Placed, chosen: Chosen) -> str:
    """Delete what is selected; a control point of a river goes back to where it was generated.

    Returns
    -------
    str
        Why nothing was done; empty if something was.
    """
    if chosen.index is None:
        delete(document, workspace, placed, chosen)
    elif is_edited(document.sketch, placed, chosen):
        document.do("Reset a point of a river", reset(document.sketch, placed, chosen))
    else:
        return "A point of a river cannot be deleted; click the river to delete all of it"
    return ""
