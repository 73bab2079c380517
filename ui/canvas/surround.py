"""What lies around the sheet: a neutral ground, the sheet's soft shadow and its border."""

from __future__ import annotations

from dataclasses import dataclass

from PyQt6.QtCore import QRect, QRectF
from PyQt6.QtGui import QColor, QPainter, QPen, QRegion

from sketchterrain.ui.look.theme import theme

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
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        shadow = QColor(colours.shadow)
        for step in range(reach + drop):
            shadow.setAlphaF(colours.shadow.alphaF() * (1.0 - step / (reach + drop)) ** 2)
            away = step - drop + 0.5
            painter.setPen(QPen(shadow, 1.0))
            grown = QRectF(sheet.translated(0, drop)).adjusted(-away, -away, away, away)
            painter.drawRoundedRect(grown, max(away, 0.0), max(away, 0.0))
        line = max(round(colours.ratio), 1)
        painter.fillRect(sheet.adjusted(-line, -line, line, line), colours.border)
    painter.restore()
