"""The picture of the sketch as the models say: which layers, relief and adherence, in which colours."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from PyQt6.QtCore import QObject, QRect, QRectF, pyqtSignal

from sketchterrain.ui.canvas.flattening import Flattening
from sketchterrain.ui.canvas.hatch_table import HatchTable
from sketchterrain.ui.canvas.paints import hatches_of, paints_of
from sketchterrain.ui.canvas.sheet import Sheet
from sketchterrain.ui.canvas.surround import surround
from sketchterrain.ui.canvas.underlays import adherence_image, relief_image
from sketchterrain.ui.look.theme import looks

if TYPE_CHECKING:
    from PyQt6.QtGui import QPainter

    from sketchterrain.sketch.box import Box
    from sketchterrain.ui.canvas.desk import Desk
    from sketchterrain.ui.engine.messages import Adherence, Relief

__all__ = ["Shown"]


class Shown(QObject):
    """Keeps the picture of the sketch in step with the models.

    Parameters
    ----------
    desk : Desk
    parent : QObject
    """

    stale = pyqtSignal(object)
    """A `QRect` of the screen (device px) in which the picture is another one."""

    def __init__(self, desk: Desk, parent: QObject) -> None:
        super().__init__(parent)
        self._desk = desk
        self._relief: Relief | None = None
        self._tint: tuple[Adherence | None, str] = (None, "")
        hatches = HatchTable(hatches_of(desk.workspace), desk.ratio)
        flattening = Flattening(desk.document.layer, paints_of(desk.workspace))
        self._sheet = Sheet(flattening, hatches, surround(desk.ratio))

        desk.document.opened.connect(self._on_opened)
        desk.document.painted.connect(self._on_painted)
        desk.workspace.look_changed.connect(self.refresh)
        desk.workspace.overlays_changed.connect(self.refresh_pictures)
        desk.workspace.label_changed.connect(self.refresh_pictures)
        desk.link.adherence_changed.connect(self.refresh_pictures)
        desk.link.relief_changed.connect(self._on_relief)
        looks.changed.connect(self.refresh)

    def refresh(self, *_: object) -> None:
        """Compose all anew: another document, other layers are shown, another theme."""
        desk = self._desk
        self._sheet.flattening.paints = paints_of(desk.workspace)
        self._sheet.hatches = HatchTable(hatches_of(desk.workspace), desk.ratio)
        self._sheet.surround = surround(desk.ratio)
        self._sheet.spoil()
        self.refresh_pictures()

    def refresh_pictures(self, *_: object) -> None:
        """Show the relief and the adherence, or not, as the workspace says."""
        desk, shown = self._desk, self._desk.workspace.overlays
        wanted = desk.link.relief if "relief" in shown else None
        if (wanted is None) != (self._sheet.relief is None):
            self._relief = None
            self._sheet.relief = None
            self._take_relief()
            self._sheet.spoil()
        measured = desk.link.adherence if "adherence" in shown else None
        tint = (measured, desk.workspace.layer if measured is not None else "")
        if tint[0] is not self._tint[0] or tint[1] != self._tint[1]:
            self._tint = tint
            self._sheet.tint = None if measured is None else adherence_image(measured, tint[1])
            self._sheet.spoil()
        self._tell_all()

    def _tell_all(self) -> None:
        self.stale.emit(QRect(0, 0, self._desk.viewport.width, self._desk.viewport.height))

    def _on_relief(self) -> None:
        area = self._take_relief()
        if not area.isEmpty():
            self.stale.emit(area)

    def _take_relief(self) -> QRect:
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

    def _on_opened(self) -> None:
        self._relief = self._sheet.relief = None
        self._sheet.spoil()

    def _on_painted(self, layer: str, box: object) -> None:
        if any(paint.layer == layer for paint in self._sheet.flattening.paints):
            self.stale.emit(self._sheet.spoil_box(cast("Box", box)))

    def draw(self, painter: QPainter, area: QRect) -> None:
        """Draw the sketch into an area (logical px) of the canvas."""
        ratio = self._desk.ratio
        if self._sheet.surround.ratio != ratio:
            self.refresh()
        self._sheet.look(self._desk.viewport)
        source = QRectF(area.x() * ratio, area.y() * ratio, area.width() * ratio, area.height() * ratio)
        painter.drawImage(QRectF(area), self._sheet.image(), source)
