"""Small buttons of an icon alone."""

from __future__ import annotations

from PyQt6.QtCore import QSize
from PyQt6.QtWidgets import QToolButton, QWidget

from sketchterrain.ui.look.icons import icon

__all__ = ["tool_button"]

_SIDE = 18  # px of the icon


def tool_button(
    name: str, title: str, *, tip: str = "", side: int = _SIDE, parent: QWidget | None = None
) -> QToolButton:
    """Return a button with an icon.

    Parameters
    ----------
    name
        Of the icon, see `ui.look.icons`.
    title
        What it does, as those hear it who see no icon.
    tip
        What is shown beside the mouse; the title if there is none.
    side
        px of the icon.
    parent
    """
    button = QToolButton(parent)
    button.setIcon(icon(name))
    button.setIconSize(QSize(side, side))
    button.setAccessibleName(title)
    button.setToolTip(tip or title)
    return button
