"""The picture of the sketch as the models say: which layers, relief and adherence, in which colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from PyQt6.QtCore import QRect, QRectF

from sketchterrain.ui.canvas.flattening import Flattening
from sketchterrain.ui.canvas.hatch_table import HatchTable
from sketchterrain.ui.canvas.paints import hatches_of, paints_of
from sketchterrain.ui.canvas.sheet import Sheet
from sketchterrain.ui.canvas.surround import surround
from sketchterrain.ui.canvas.underlays import adherence_image, relief_image

if TYPE_CHECKING:
    from PyQt6.QtGui import QPainter

    from sketchterrain.sketch.box import Box
    from sketchterrain.ui.canvas.desk import Desk
    from sketchterrain.ui.engine.messages import Adherence, Relief

__all__ = ["Shown"]


class Shown:
    """Keeps the picture of the sketch in step with the models.

    Parameters
    ----------
    desk : Desk
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._relief: Relief | None = None
        self._tint: tuple[Adherence | None, str] = (None, "")
        hatches = HatchTable(hatches_of(desk.workspace), desk.ratio)
        flattening = Flattening(desk.document.layer, paints_of(desk.workspace))
        self._sheet = Sheet(flattening, hatches, surround(desk.ratio))

    def refresh(self) -> None:
        """Compose all anew: another document, other layers are shown, another theme."""
        desk = self._desk
        self._sheet.flattening.paints = paints_of(desk.workspace)
        self._sheet.hatches = HatchTable(hatches_of(desk.workspace), desk.ratio)
        self._sheet.surround = surround(desk.ratio)
        self._sheet.spoil()
        self.refresh_pictures()

    def refresh_pictures(self) -> None:
        """Show the relief and the adherence, or not, as the workspace says."""
        desk, shown = self._desk, self._desk.workspace.overlays
        wanted = desk.link.relief if "relief" in shown else None
        if (wanted is None) != (self._sheet.relief is None):
            self._relief = None
            self._sheet.relief = None
            self.relieved()
            self._sheet.spoil()
        measured = desk.link.adherence if "adherence" in shown else None
        tint = (measured, desk.workspace.layer if measured is not None else "")
        if tint[0] is not self._tint[0] or tint[1] != self._tint[1]:
            self._tint = tint
            self._sheet.tint = None if measured is None else adherence_image(measured, tint[1])
            self._sheet.spoil()

    def relieved(self) -> QRect:
        """Take the newest relief; return the area of the screen (device px) in which it is another one."""
        relief, sketch = self._desk.link.relief, self._desk.document.sketch
        if relief is None or "relief" not in self._desk.workspace.overlays:
            return QRect()
        rows, columns = relief.shade.shape
        if (rows, columns) != (-(-sketch.height_px // relief.step), -(-sketch.width_px // relief.step)):
            return QRect()  # of the document before
        before, self._relief = self._relief, relief
        self._sheet.relief, self._sheet.relief_step = relief_image(relief), relief.step
        box = (0, 0, rows, columns)
        if before is not None and before.shade.shape == relief.shade.shape:
            changed = before.shade != relief.shade
            down, across = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
            if not len(down):
                return QRect()
            box = (int(down[0]), int(across[0]), int(down[-1]) + 1, int(across[-1]) + 1)
        top, left, bottom, right = (side * relief.step for side in box)
        margin = 2 * relief.step
        area = self._sheet.area_of((top - margin, left - margin, bottom + margin, right + margin))
        self._sheet.spoil(area)
        return area

    def painted(self, layer: str, box: Box) -> QRect:
        """Follow a layer's pixels; return the area of the screen (device px) that is another one."""
        if all(paint.layer != layer for paint in self._sheet.flattening.paints):
            return QRect()
        return self._sheet.spoil_box(box)

    def draw(self, painter: QPainter, area: QRect) -> None:
        """Draw the sketch into an area (logical px) of the canvas."""
        ratio = self._desk.ratio
        if self._sheet.surround.ratio != ratio:
            self.refresh()
        self._sheet.look(self._desk.viewport)
        source = QRectF(area.x() * ratio, area.y() * ratio, area.width() * ratio, area.height() * ratio)
        painter.drawImage(QRectF(area), self._sheet.image(), source)
