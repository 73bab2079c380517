"""The menu of a place of the terrain: of what stands there, and what could be added."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

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

__all__ = ["add", "delete", "delete_or_reset", "feature_menu"]


def feature_menu(
    parent: QWidget,
    document: Document,
    workspace: Workspace,
    placed: Placed,
    *,
    chosen: Chosen | None,
    place: tuple[float, float] | None,
) -> QMenu:
    """Return the menu of a place; who shows it deletes it.

    Parameters
    ----------
    parent
    document, workspace, placed
    chosen
        What stands there.
    place
        Where it is (m); None in the sky, where nothing can be added.
    """
    menu = QMenu(parent)
    if chosen is not None and is_there(placed, chosen):
        _add_own(menu, document, workspace, placed, chosen)
    if place is not None:
        menu.addSeparator()
        x, y = place
        for kind in FEATURE_TYPES:
            _add(menu, f"Add {kind} here", "add", partial(add, document, workspace, kind, x, y))
    return menu


def add(document: Document, workspace: Workspace, kind: str, x: float, y: float) -> None:
    """Add a feature at a place (m), and select it."""
    sketch = added_at(document.sketch, kind, x, y)
    document.do(f"Add {kind}", sketch)
    workspace.chosen = Chosen("feature", sketch.edits[-1].feature or 0)


def _add_own(menu: QMenu, document: Document, workspace: Workspace, placed: Placed, chosen: Chosen) -> None:
    name = name_of(placed, chosen)
    if chosen.kind == "feature":
        if is_locked(document.sketch, chosen):
            _add(
                menu,
                f"Unlock {name}",
                "unlock",
                lambda: document.do(f"Unlock {name}", unlocked(document.sketch, chosen)),
            )
        else:
            _add(
                menu,
                f"Lock {name}",
                "lock",
                lambda: document.do(f"Lock {name}", locked(document.sketch, placed, chosen)),
            )
    action = _add(
        menu,
        f"Reset {name}",
        "reset",
        lambda: document.do(f"Reset {name}", reset(document.sketch, placed, chosen)),
    )
    action.setEnabled(is_edited(document.sketch, placed, chosen))
    _add(menu, f"Delete {name}", "delete", lambda: delete(document, workspace, placed, chosen))


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


def _add(menu: QMenu, text: str, name: str, do: Callable[[], object]) -> QAction:
    action = QAction(icon(name), text, menu)
    action.triggered.connect(lambda _=False: do())
    menu.addAction(action)
    return action
