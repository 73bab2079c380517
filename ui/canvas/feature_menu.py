"""The menu of a feature, and of a place of the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtWidgets import QMenu

from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.sketch import LAYERS
from sketchterrain.ui.commands import placed_edits
from sketchterrain.ui.commands.chosen_parts import name_of
from sketchterrain.ui.engine.messages import GoTo
from sketchterrain.ui.look.icons import icon

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QWidget

    from sketchterrain.sketch import Sketch
    from sketchterrain.ui.canvas.desk import Desk
    from sketchterrain.ui.models.workspace import Chosen

__all__ = ["feature_menu"]

_RADIUS = 0.07  # of the sketch's extent: what is added is as large


def feature_menu(parent: QWidget, desk: Desk, chosen: Chosen | None, x: float, y: float) -> QMenu:
    """Return the menu for what is chosen and for a place.

    Parameters
    ----------
    parent
    desk
    chosen
        What lies there; None: nothing.
    x, y
        Where it was asked for (m).
    """
    menu = QMenu(parent)
    document, placed = desk.document, desk.link.placed
    if chosen is not None and placed is not None:
        sketch, name = document.sketch, name_of(placed, chosen)
        if chosen.kind == "feature":
            if placed_edits.is_locked(sketch, chosen):
                _offer(menu, desk, "unlock", f"Unlock {name}", placed_edits.unlocked(sketch, chosen))
            else:
                _offer(menu, desk, "lock", f"Lock {name}", placed_edits.locked(sketch, placed, chosen))
        _offer(menu, desk, "reset", f"Reset {name}", placed_edits.reset(sketch, placed, chosen))
        _offer(menu, desk, "delete", f"Delete {name}", placed_edits.deleted(sketch, chosen))
        menu.addSeparator()
    adding = menu.addMenu(icon("add"), "Add here")
    assert adding is not None  # noqa: S101 # PyQt's stubs allow None where Qt never gives it
    for kind in FEATURE_TYPES:
        title = f"Add {kind}"
        _offer(adding, desk, None, title, _with_one(document.sketch, kind, x, y))
    look = menu.addAction(icon("orbit"), "Look here in 3-D")
    assert look is not None  # noqa: S101
    look.triggered.connect(lambda: desk.link.tell(GoTo(x, y)))
    return menu


def _with_one(sketch: Sketch, kind: str, x: float, y: float) -> Sketch:
    strength = LAYERS[kind].parameters["density" if kind == "forest" else "height"].default
    assert isinstance(strength, float)  # noqa: S101 # declared so
    return placed_edits.added(sketch, kind, x, y, _RADIUS * sketch.extent, strength)


def _offer(menu: QMenu, desk: Desk, sign: str | None, title: str, sketch: Sketch) -> None:
    """Add an action that leads to a sketch; greyed if that is the current one."""
    text = title if sign is not None else title.removeprefix("Add ").capitalize()
    action = menu.addAction(text)
    assert action is not None  # noqa: S101
    if sign is not None:
        action.setIcon(icon(sign))
    action.setEnabled(sketch is not desk.document.sketch)
    action.triggered.connect(lambda: desk.document.do(title, sketch))
