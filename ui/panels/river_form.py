"""A placed river: how wide it is, and where its control points lie."""

from __future__ import annotations

import dataclasses

import numpy as np
from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QGridLayout, QLabel, QVBoxLayout, QWidget

from sketchterrain.features import River
from sketchterrain.sketch import ACTIONS
from sketchterrain.ui.commands.chosen_parts import name_of, parent_of, river_of
from sketchterrain.ui.commands.placed_edits import point_moved, widened, width_of
from sketchterrain.ui.engine.protocol import Placed
from sketchterrain.ui.look.theme import SPACING
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Chosen, Workspace
from sketchterrain.ui.panels.number_box import NumberBox
from sketchterrain.ui.panels.number_row import NumberRow
from sketchterrain.ui.panels.text import faint_label
from sketchterrain.ui.panels.wording import number

_X, _Y = (
    dataclasses.replace(ACTIONS["move_point"].needs[name], help=f"{way} of the sketch's south-west corner")
    for name, way in (("x", "east"), ("y", "north"))
)


class RiverForm(QWidget):
    """The width of a river and one control point of it; each that is set is kept as an edit."""

    def __init__(self, document: Document, workspace: Workspace, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._workspace = workspace
        self._placed: Placed | None = None
        self._chosen: Chosen | None = None
        self._asked: tuple[Placed, Chosen, float, float] | None = None
        self.layer, self.label, self.line = "river", 1, ""
        self.width_row = NumberRow(ACTIONS["width"].needs["width"], resets=False, decimals=1)
        self.points = self._make_points()
        self.east = NumberRow(_X, title="East", resets=False, decimals=1)
        self.north = NumberRow(_Y, title="North", resets=False, decimals=1)
        self._note = faint_label("", self)
        self.width_row.edited.connect(self._widen)
        self.east.edited.connect(lambda value, key: self._move(float(value), self.north.number, key))
        self.north.edited.connect(lambda value, key: self._move(self.east.number, float(value), key))
        self._lay_out()

    def show_chosen(self, placed: Placed, chosen: Chosen) -> None:
        """Show a river that is there."""
        river = river_of(placed, chosen)
        if river is None:
            return
        if chosen != self._chosen:
            for row in (self.width_row, self.east, self.north):
                row.finish()  # what was typed belongs to the river that it was typed for
        self._placed, self._chosen = placed, chosen
        self.label = max(river.label, 1)
        steps = np.diff(river.centreline[:, :2], axis=0)
        length = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        self.line = f"{number(length / 1000, decimals=2)} km, painted with label {river.label}"
        self.width_row.show_value(
            width_of(self._document.sketch, placed, chosen) or float(np.median(river.width))
        )
        self._show_points(len(river.points), chosen.index)
        self._show_point(placed, river, chosen.index)

    def _show_points(self, count: int, index: int | None) -> None:
        with QSignalBlocker(self.points):
            self.points.setSuffix(f" of {count}")
            self.points.setRange(0, count)
            self.points.setValue(0 if index is None else index + 1)

    def _show_point(self, placed: Placed, river: River, index: int | None) -> None:
        there = index is not None and 0 <= index < len(river.points)
        joins = there and index == len(river.points) - 1 and parent_of(placed, river) is not None
        for row in (self.east, self.north):
            row.setEnabled(there and not joins)
        if index is None or not there:
            self._note.setText("Choose a control point here, in the sketch or in the view to set its place.")
            return
        east, north = self._document.sketch.size
        self.east.set_span(0.0, east)
        self.north.set_span(0.0, north)
        x, y = self._place(placed, river, index)
        self.east.show_value(x)
        self.north.show_value(y)
        level = number(float(river.points[index, 2]), decimals=1)
        self._note.setText(
            "Here it joins another river, and follows it."
            if joins
            else f"The water stands at {level} m there."
        )

    def _place(self, placed: Placed, river: River, index: int) -> tuple[float, float]:
        """Return where a control point lies, or will lie once what was asked for is placed."""
        if self._asked is not None and self._asked[0] is placed and self._asked[1] == self._chosen:
            return self._asked[2:]
        return float(river.points[index, 0]), float(river.points[index, 1])

    def _choose_point(self, number: float) -> None:
        if self._chosen is not None:
            index = int(number) - 1 if number else None
            self._workspace.chosen = dataclasses.replace(self._chosen, index=index)

    def _widen(self, width: float, key: object) -> None:
        placed, chosen = self._placed, self._chosen
        if placed is not None and chosen is not None:
            changed = widened(self._document.sketch, chosen, width)
            self._document.do(f"Set the width of {name_of(placed, chosen)}", changed, merge=key)

    def _move(self, x: float, y: float, key: object) -> None:
        placed, chosen = self._placed, self._chosen
        if placed is not None and chosen is not None:
            changed = point_moved(self._document.sketch, placed, chosen, x, y)
            self._asked = (placed, chosen, x, y)
            self._document.do(f"Move a point of {name_of(placed, chosen)}", changed, merge=key)

    def _make_points(self) -> NumberBox:
        box = NumberBox(0, 0, step=1.0, decimals=0, parent=self)
        box.setSpecialValueText("none")
        box.setAccessibleName("Control point")
        box.setToolTip("The river runs through its control points, from the spring, 1, to the mouth")
        box.valueChanged.connect(self._choose_point)
        return box

    def _lay_out(self) -> None:
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SPACING)
        down.addWidget(self.width_row)
        line = QGridLayout()
        title = QLabel("Control &point", self)
        title.setBuddy(self.points)
        line.addWidget(title, 0, 0)
        line.addWidget(self.points, 0, 1)
        line.setColumnStretch(0, 1)
        down.addLayout(line)
        for row in (self.east, self.north, self._note):
            down.addWidget(row)
