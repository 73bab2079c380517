"""The menu of a feature, and of a place of the ground."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.ui.doing_menu import DoingMenu, offer_chosen
from sketchterrain.ui.engine.orders import GoTo
from sketchterrain.ui.models.chosen_acts import add

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.canvas.desk import Desk
    from sketchterrain.ui.models.workspace import Chosen

__all__ = ["feature_menu"]


def feature_menu(parent: QWidget, desk: Desk, chosen: Chosen | None, x: float, y: float) -> DoingMenu:
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
    menu = DoingMenu(parent)
    document, workspace, placed = desk.document, desk.workspace, desk.link.placed
    if chosen is not None and placed is not None:
        offer_chosen(menu, document, workspace, placed, chosen)
        menu.addSeparator()
    adding = menu.within("add", "Add here")
    for kind in FEATURE_TYPES:
        adding.offer("", kind.capitalize(), partial(add, document, workspace, kind, x, y))
    menu.offer("orbit", "Look here in 3-D", partial(desk.link.tell, GoTo(x, y)))
    return menu
