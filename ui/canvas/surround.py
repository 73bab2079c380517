"""What lies around the sheet: a neutral ground, the sheet's soft shadow and its border."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from PyQt6.QtCore import QRect
from PyQt6.QtGui import QColor, QRegion

from sketchterrain.ui.look.theme import theme

if TYPE_CHECKING:
    from PyQt6.QtGui import QPainter

__all__ = ["Surround", "draw_surround", "surround"]

_REACH = 10  # px of the shadow
_DROP = 2  # px that it lies lower


@dataclass(frozen=True)
class Surround:
    """Colours around the sheet, and device pixels a logical one."""

    ground: QColor
    shadow: QColor
    border: QColor
    ratio: float


def surround(ratio: float) -> Surround:
    """Return what goes with the theme that is shown."""
    dark = theme().name == "dark"
    shadow = QColor(0, 0, 0, 200 if dark else 90)
    border = QColor(0, 0, 0) if dark else QColor(150, 150, 147)
    return Surround(theme().canvas, shadow, border, ratio)


def draw_surround(painter: QPainter, area: QRect, sheet: QRect, colours: Surround) -> None:
    """Draw the ground and, around the sheet, its shadow and border; what lies on the sheet is undefined.

    Parameters
    ----------
    painter
        On device pixels.
    area
        To draw in.
    sheet
        Where the sheet lies.
    colours
    """
    painter.save()
    painter.setClipRegion(QRegion(area) - QRegion(sheet))
    painter.fillRect(area, colours.ground)
    reach, drop = round(_REACH * colours.ratio), round(_DROP * colours.ratio)
    if sheet.adjusted(-reach, -reach, reach, reach + drop).intersects(area):
        shadow = QColor(colours.shadow)
        for step in range(reach + drop):
            shadow.setAlphaF(colours.shadow.alphaF() * (1.0 - step / (reach + drop)) ** 2)
            for edge in _frame(sheet.translated(0, drop), step - drop):
                painter.fillRect(edge, shadow)
        line = max(round(colours.ratio), 1)
        painter.fillRect(sheet.adjusted(-line, -line, line, line), colours.border)
    painter.restore()


def _frame(inner: QRect, step: int) -> tuple[QRect, QRect, QRect, QRect]:
    """Return the four edges, a pixel wide, of the rectangle that lies `step` px around another one."""
    grown = inner.adjusted(-step - 1, -step - 1, step + 1, step + 1)
    width, height = grown.width(), grown.height()
    corner = max(step // 2, 0)  # left out at the ends: it looks round
    return (
        QRect(grown.left() + corner, grown.top(), width - 2 * corner, 1),
        QRect(grown.left() + corner, grown.bottom(), width - 2 * corner, 1),
        QRect(grown.left(), grown.top() + 1 + corner, 1, height - 2 - 2 * corner),
        QRect(grown.right(), grown.top() + 1 + corner, 1, height - 2 - 2 * corner),
    )
