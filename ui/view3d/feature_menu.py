"""The menu of a place of the terrain: of what stands there, and what could be added."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.ui.commands.chosen_parts import is_there
from sketchterrain.ui.doing_menu import DoingMenu, offer_chosen
from sketchterrain.ui.models.chosen_acts import add

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.engine.messages import Placed
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.workspace import Chosen, Workspace

__all__ = ["feature_menu"]


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
        offer_chosen(menu, document, workspace, placed, chosen)
    if place is not None:
        menu.addSeparator()
        x, y = place
        for kind in FEATURE_TYPES:
            menu.offer("add", f"Add {kind} here", partial(add, document, workspace, kind, x, y))
    return menu
