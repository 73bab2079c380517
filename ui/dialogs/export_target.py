"""An export to a program or a plain format: what is asked of it, and what it will be."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from PyQt6.QtCore import pyqtSignal
from PyQt6.QtWidgets import QWidget

from sketchterrain.disk import amount
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.export.planning import Plan
from sketchterrain.export.sidecar import SIDECAR
from sketchterrain.export.target import ExportOptions, Target
from sketchterrain.export_plans import memory_needed, plan_of
from sketchterrain.sketch import Sketch
from sketchterrain.ui.dialogs.export_options import TargetControls
from sketchterrain.ui.dialogs.kept_controls import Kept
from sketchterrain.ui.dialogs.sheet import note, part
from sketchterrain.ui.export_wish import TargetWish


class TargetWishes(QWidget):
    """Asks what a target wants to know, and tells what comes of it."""

    changed = pyqtSignal()
    mark = SIDECAR
    """Name of a file that an export leaves."""

    def __init__(self, sketch: Sketch, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._sketch = sketch
        self._target: Target | None = None
        self._options: ExportOptions | None = None
        self.problem = ""
        self.controls = TargetControls(is_wide=sketch.size[0] >= sketch.size[1], parent=self)
        self._line, self._told = note(), note()
        rows = part(self)
        for widget in (self._line, self.controls, self._told):
            rows.addWidget(widget)
        self.controls.changed.connect(self._show)

    def use(self, target: Target, kept: Mapping[str, object]) -> None:
        """Ask for a target, with what was kept of it."""
        self._target = target
        self._line.setText(f"{target.line[:1].upper()}{target.line[1:]}.")
        self.controls.use(target, kept)

    def kept(self) -> Kept:
        """Return what is set, to be kept."""
        return self.controls.kept()

    def wish(self, folder: Path, device: str | None) -> TargetWish:
        """Return what is asked for, into a folder, on a device."""
        if self._target is None or self._options is None:
            raise RuntimeError("expected a target, and options that can be meant")
        return TargetWish(folder, self._target.name, self._options, device)

    def _show(self) -> None:
        if self._target is None:
            return
        self.problem, self._options = "", None
        told = ""
        try:
            options = self.controls.options()
            plan = plan_of(self._sketch, self._target.name, options)
            self._options, told = options, plan_line(plan, self._sketch)
        except SketchterrainError as error:
            self.problem = one_line(error)
        self._told.setText(told)
        self.changed.emit()


def plan_line(plan: Plan, sketch: Sketch) -> str:
    """Return what an export will be, for a person: vertices, tiles, the ground they cover, what it takes."""
    grid, (columns, rows), tiles = plan.grid, plan.tile_side, plan.tiling.count
    across, up = grid.spacing
    apart = f"{across:.4g} m" if f"{across:.4g}" == f"{up:.4g}" else f"{across:.4g} m and {up:.4g} m"
    what = f"{tiles} tiles of {columns} × {rows}" if tiles > 1 else f"{columns} × {rows} vertices"
    lines = [f"{what}, {apart} apart."]
    width, height = grid.east - grid.west, grid.north - grid.south
    if width > sketch.size[0] + across / 2 or height > sketch.size[1] + up / 2:
        lines.append(f"{width:.0f} × {height:.0f} m: the world goes on beyond the sketch.")
    disk = plan.target.disk * columns * rows * tiles
    plants = " besides the plants" if plan.options.plants else ""
    lines.append(
        f"Takes up to {amount(disk)} of disk{plants} and about {amount(memory_needed(plan))} of memory."
    )
    return " ".join(lines)
