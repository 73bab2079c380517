"""Forms for placed features, rivers and lakes; each number that is set becomes an edit."""

from __future__ import annotations

import dataclasses

import numpy as np
from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QGridLayout, QLabel, QVBoxLayout, QWidget

from sketchterrain.document.edits import ACTIONS, ADDED_BIT
from sketchterrain.document.sketch import Sketch
from sketchterrain.placement.feature_types import FILL_BIT, River
from sketchterrain.ui.commands.placed_edits import (
    find_lake,
    find_parent_river,
    find_point,
    find_river,
    moved,
    name_of,
    point_moved,
    resized,
    strength_of,
    strengthened,
    widened,
    width_of,
)
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.theme import SPACING
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.form import NumberRow
from sketchterrain.ui.panels.numbers import NumberBox, number
from sketchterrain.ui.panels.parts import faint_label

_SHAPE = ACTIONS["add"].required
_HEIGHT = dataclasses.replace(_SHAPE["strength"], name="height", low=0.0, unit="m", help="from foot to top")
_SHARE = dataclasses.replace(
    _SHAPE["strength"], name="density", high=1.0, help="share of the trees that the ground can carry"
)
_RADIUS = dataclasses.replace(_SHAPE["radius"], help="how far it reaches from its middle")
_X, _Y = _SHAPE["x"], _SHAPE["y"]


class FeatureForm(QWidget):
    """Numbers of a feature; each that is set is kept as an edit of it."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._placed: Placement | None = None
        self._chosen: Selection | None = None
        self.layer, self.label, self.line = "mountain", 1, ""
        self.rows = {
            "height": NumberRow(_HEIGHT, resets=False, decimals=1),
            "density": NumberRow(_SHARE, resets=False, decimals=2),
            "radius": NumberRow(_RADIUS, resets=False, decimals=1),
            "x": NumberRow(_X, title="East", resets=False, decimals=1),
            "y": NumberRow(_Y, title="North", resets=False, decimals=1),
        }
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SPACING)
        for name, row in self.rows.items():
            down.addWidget(row)
            row.edited.connect(lambda value, key, name=name: self._set(name, float(value), key))

    def show_chosen(self, placed: Placement, selection: Selection) -> None:
        """Show a feature that is there."""
        point = find_point(placed, selection)
        if point is None:
            return
        if selection != self._chosen:
            for row in self.rows.values():
                row.finish()  # what was typed belongs to the feature that it was typed for
        self._placed, self._chosen = placed, selection
        self.layer, self.line = name_of(placed, selection), _line(selection.id)
        self._show_spans()
        values = self._values(point)
        for name, row in self.rows.items():
            row.show_value(values[name])
        self.rows["height"].setVisible(self.layer != "forest")
        self.rows["density"].setVisible(self.layer == "forest")

    def _values(self, point: np.void) -> dict[str, float]:
        sketch = self._document.sketch
        selection, placed = self._chosen, self._placed
        strength = (
            strength_of(sketch, placed, selection) if placed is not None and selection is not None else None
        )
        given = float(point["strength"]) if strength is None else strength
        values = {name: float(point[name]) for name in ("x", "y", "radius")} | self._said(sketch)
        return {**values, "height": given, "density": min(given, 1.0)}

    def _said(self, sketch: Sketch) -> dict[str, float]:
        """Return what edits say of the feature already: it is placed so only a moment later."""
        said: dict[str, float] = {}
        for edit in sketch.edits:
            if self._chosen is not None and edit.feature == self._chosen.id:
                said |= {
                    name: float(value) for name, value in edit.values.items() if name in ("x", "y", "radius")
                }
        return said

    def _show_spans(self) -> None:
        east, north = self._document.sketch.size
        self.rows["x"].set_span(0.0, east)
        self.rows["y"].set_span(0.0, north)
        self.rows["radius"].set_span(max(east, north) / 1000, max(east, north))

    def _set(self, name: str, value: float, key: object) -> None:
        placed, selection = self._placed, self._chosen
        if placed is None or selection is None:
            return
        sketch = self._document.sketch
        kind = name_of(placed, selection)
        if name in ("x", "y"):
            at = {each: self.rows[each].number for each in ("x", "y")} | {name: value}
            self._document.do(f"Move {kind}", moved(sketch, placed, selection, at["x"], at["y"]), merge=key)
        elif name == "radius":
            self._document.do(f"Resize {kind}", resized(sketch, placed, selection, value), merge=key)
        else:
            changed = strengthened(sketch, placed, selection, value)
            self._document.do(f"Set {name} of {kind}", changed, merge=key)


def _line(feature: int) -> str:
    if feature & ADDED_BIT and not feature & int(FILL_BIT):
        return "added by hand"
    return "placed in unpainted land" if feature & int(FILL_BIT) else "placed where it was painted"


class RiverForm(QWidget):
    """The width of a river and one control point of it; each that is set is kept as an edit."""

    def __init__(self, document: Document, workspace: Workspace, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._workspace = workspace
        self._placed: Placement | None = None
        self._chosen: Selection | None = None
        self._asked: tuple[Placement, Selection, float, float] | None = None
        self.layer, self.label, self.line = "river", 1, ""
        self.width_row = NumberRow(ACTIONS["width"].required["width"], resets=False, decimals=1)
        self.points = self._make_points()
        self.east = NumberRow(_X, title="East", resets=False, decimals=1)
        self.north = NumberRow(_Y, title="North", resets=False, decimals=1)
        self._note = faint_label("", self)
        self.width_row.edited.connect(self._widen)
        self.east.edited.connect(lambda value, key: self._move(float(value), self.north.number, key))
        self.north.edited.connect(lambda value, key: self._move(self.east.number, float(value), key))
        self._lay_out()

    def show_chosen(self, placed: Placement, selection: Selection) -> None:
        """Show a river that is there."""
        river = find_river(placed, selection)
        if river is None:
            return
        if selection != self._chosen:
            for row in (self.width_row, self.east, self.north):
                row.finish()  # what was typed belongs to the river that it was typed for
        self._placed, self._chosen = placed, selection
        self.label = max(river.label, 1)
        steps = np.diff(river.centreline[:, :2], axis=0)
        length = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        self.line = f"{number(length / 1000, decimals=2)} km, painted with label {river.label}"
        self.width_row.show_value(
            width_of(self._document.sketch, placed, selection) or float(np.median(river.width))
        )
        self._show_points(len(river.points), selection.index)
        self._show_point(placed, river, selection.index)

    def _show_points(self, count: int, index: int | None) -> None:
        with QSignalBlocker(self.points):
            self.points.setSuffix(f" of {count}")
            self.points.setRange(0, count)
            self.points.setValue(0 if index is None else index + 1)

    def _show_point(self, placed: Placement, river: River, index: int | None) -> None:
        there = index is not None and 0 <= index < len(river.points)
        joins = there and index == len(river.points) - 1 and find_parent_river(placed, river) is not None
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

    def _place(self, placed: Placement, river: River, index: int) -> tuple[float, float]:
        """Return where a control point lies, or will lie once what was asked for is placed."""
        if self._asked is not None and self._asked[0] is placed and self._asked[1] == self._chosen:
            return self._asked[2:]
        return float(river.points[index, 0]), float(river.points[index, 1])

    def _choose_point(self, number: float) -> None:
        if self._chosen is not None:
            index = int(number) - 1 if number else None
            self._workspace.selection = dataclasses.replace(self._chosen, index=index)

    def _widen(self, width: float, key: object) -> None:
        placed, selection = self._placed, self._chosen
        if placed is not None and selection is not None:
            changed = widened(self._document.sketch, selection, width)
            self._document.do(f"Set the width of {name_of(placed, selection)}", changed, merge=key)

    def _move(self, x: float, y: float, key: object) -> None:
        placed, selection = self._placed, self._chosen
        if placed is not None and selection is not None:
            changed = point_moved(self._document.sketch, placed, selection, x, y)
            self._asked = (placed, selection, x, y)
            self._document.do(f"Move a point of {name_of(placed, selection)}", changed, merge=key)

    def _make_points(self) -> NumberBox:
        box = NumberBox(0, 0, decimals=0, parent=self)
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


class LakeForm(QWidget):
    """What a lake is like."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.layer, self.label, self.line = "lake", 1, ""
        self._text = faint_label("", self)
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.addWidget(self._text)

    def show_chosen(self, placed: Placement, selection: Selection) -> None:
        """Show a lake that is there."""
        lake = find_lake(placed, selection)
        if lake is None:
            return
        self.label = max(lake.label, 1)  # 0: nobody painted it, a river fills it
        self.line = f"painted with label {lake.label}" if lake.label else "filled by a river"
        self._text.setText(
            f"Its water stands at {number(lake.level, decimals=1)} m, as high as its rim can hold, and is "
            f"{number(lake.depth, decimals=1)} m deep."
        )
