"""Which cursor says what dragging here would do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from PyQt6.QtCore import Qt

if TYPE_CHECKING:
    from sketchterrain.ui.view3d.marks import Grip

__all__ = ["grip_cursor"]

_ALONG = (
    Qt.CursorShape.SizeHorCursor,
    Qt.CursorShape.SizeFDiagCursor,
    Qt.CursorShape.SizeVerCursor,
    Qt.CursorShape.SizeBDiagCursor,
)


def grip_cursor(grip: Grip) -> Qt.CursorShape:
    """Return the cursor over a handle: all ways, or along the way in which it is drawn out."""
    if grip.handle.role in ("move", "point"):
        return Qt.CursorShape.SizeAllCursor
    angle = math.degrees(math.atan2(grip.y - grip.base_y, grip.x - grip.base_x))
    return _ALONG[round(angle / 45.0) % 4]
