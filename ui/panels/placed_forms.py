"""Forms for placed features, rivers and lakes; a changed number becomes an edit."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QLabel, QWidget

from sketchterrain.document.edits import ACTIONS, ADDED_BIT
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
from sketchterrain.ui.look.theme import column, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.panels.form import NumberRow
from sketchterrain.ui.panels.numbers import NumberBox, number
from sketchterrain.ui.panels.parts import faint_label

_SHAPE = ACTIONS["add"].required
_HEIGHT = dataclasses.replace(_SHAPE["strength"], name="height", low=0.0, unit="m", help="from foot to top")
_DENSITY = dataclasses.replace(
    _SHAPE["strength"], name="density", high=1.0, help="share of the trees that the ground can carry"
)
_RADIUS = dataclasses.replace(_SHAPE["radius"], help="how far it extends from its centre")
_X, _Y = _SHAPE["x"], _SHAPE["y"]


class FeatureForm(QWidget):
    """Position, size and strength of a feature."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._shown: tuple[Placement, Selection] | None = None
        self.layer, self.label, self.line = "mountain", 1, ""
        self.rows = {
            "height": NumberRow(_HEIGHT, has_reset=False, decimals=1),
            "density": NumberRow(_DENSITY, has_reset=False, decimals=2),
            "radius": NumberRow(_RADIUS, has_reset=False, decimals=1),
            "x": NumberRow(_X, title="East", has_reset=False, decimals=1),
            "y": NumberRow(_Y, title="North", has_reset=False, decimals=1),
        }
        column(self, *self.rows.values())
        for name, field in self.rows.items():
            field.edited.connect(partial(self._apply, name))

    def show_selection(self, placed: Placement, selection: Selection) -> None:
        point = find_point(placed, selection)
        if point is None:
            return
        if self._shown is not None and self._shown[1] != selection:
            for field in self.rows.values():
                field.finish()  # the text being typed is for the previous feature
        self._shown = placed, selection
        self.layer, self.line = name_of(placed, selection), _origin(selection.id)
        east, north = self._document.sketch.size
        self.rows["x"].set_slider_range(0.0, east)
        self.rows["y"].set_slider_range(0.0, north)
        self.rows["radius"].set_slider_range(max(east, north) / 1000, max(east, north))
        for name, value in self._values(placed, selection, point).items():
            self.rows[name].show_value(value)
        self.rows["height"].setVisible(self.layer != "forest")
        self.rows["density"].setVisible(self.layer == "forest")

    def _values(self, placed: Placement, selection: Selection, point: np.void) -> dict[str, float]:
        """Return the values of a feature with pending edits, which are placed a moment later."""
        values = {name: float(point[name]) for name in ("x", "y", "radius")}
        for edit in self._document.sketch.edits:
            if edit.feature == selection.id:
                values |= {name: float(value) for name, value in edit.values.items() if name in values}
        strength = strength_of(self._document.sketch, placed, selection)
        height = float(point["strength"]) if strength is None else strength
        return {**values, "height": height, "density": min(height, 1.0)}

    def _apply(self, name: str, value: float, key: object) -> None:
        if self._shown is None:
            return
        sketch, kind = self._document.sketch, name_of(*self._shown)
        if name in ("x", "y"):
            position = {each: self.rows[each].number for each in ("x", "y")} | {name: float(value)}
            changed, title = moved(sketch, *self._shown, position["x"], position["y"]), f"Move {kind}"
        elif name == "radius":
            changed, title = resized(sketch, *self._shown, float(value)), f"Resize {kind}"
        else:
            changed, title = strengthened(sketch, *self._shown, float(value)), f"Set {name} of {kind}"
        self._document.do(title, changed, merge=key)


def _origin(feature: int) -> str:
    if feature & int(FILL_BIT):
        return "placed in unpainted terrain"
    return "added by hand" if feature & ADDED_BIT else "placed where it was painted"


class RiverForm(QWidget):
    """The width of a river and the position of one control point."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._shown: tuple[Placement, Selection] | None = None
        self._pending: tuple[Placement, Selection, float, float] | None = None  # a moved point
        self.layer, self.label, self.line = "river", 1, ""
        self.width_row = NumberRow(ACTIONS["width"].required["width"], has_reset=False, decimals=1)
        self.points = NumberBox(0, 0, decimals=0)
        self.points.setSpecialValueText("none")
        self.points.setAccessibleName("Control point")
        self.points.setToolTip("The river runs through its control points, from the spring, 1, to the mouth")
        self.east = NumberRow(_X, title="East", has_reset=False, decimals=1)
        self.north = NumberRow(_Y, title="North", has_reset=False, decimals=1)
        self._note = faint_label()
        title = QLabel("Control &point")
        title.setBuddy(self.points)
        points = row(None, (title, 1), self.points)
        column(self, self.width_row, points, self.east, self.north, self._note)
        self.points.valueChanged.connect(self._select_point)
        self.width_row.edited.connect(self._set_width)
        self.east.edited.connect(lambda value, key: self._move(float(value), self.north.number, key))
        self.north.edited.connect(lambda value, key: self._move(self.east.number, float(value), key))

    def show_selection(self, placed: Placement, selection: Selection) -> None:
        river = find_river(placed, selection)
        if river is None:
            return
        if self._shown is not None and self._shown[1] != selection:
            for field in (self.width_row, self.east, self.north):
                field.finish()  # the text being typed is for the previous river
        self._shown = placed, selection
        self.label = max(river.label, 1)
        steps = np.diff(river.centreline[:, :2], axis=0)
        length = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        self.line = f"{number(length / 1000, decimals=2)} km, painted with label {river.label}"
        width = width_of(self._document.sketch, placed, selection) or float(np.median(river.width))
        self.width_row.show_value(width)
        with QSignalBlocker(self.points):
            self.points.setSuffix(f" of {len(river.points)}")
            self.points.setRange(0, len(river.points))
            self.points.setValue(0 if selection.index is None else selection.index + 1)
        self._show_point(placed, river, selection)

    def _show_point(self, placed: Placement, river: River, selection: Selection) -> None:
        index, count = selection.index, len(river.points)
        is_point = index is not None and 0 <= index < count
        joins = is_point and index == count - 1 and find_parent_river(placed, river) is not None
        for field in (self.east, self.north):
            field.setEnabled(is_point and not joins)
        if index is None or not is_point:
            self._note.setText("Select a control point here, in the sketch or in the view to move it.")
            return
        x, y, level = river.points[index].tolist()[:3]
        if self._pending is not None and self._pending[0] is placed and self._pending[1] == selection:
            x, y = self._pending[2:]
        for field, end, value in zip(
            (self.east, self.north), self._document.sketch.size, (x, y), strict=True
        ):
            field.set_slider_range(0.0, end)
            field.show_value(value)
        self._note.setText(
            "Here it joins another river, and follows it."
            if joins
            else f"Water level: {number(level, decimals=1)} m."
        )

    def _select_point(self, number: float) -> None:
        if self._shown is not None:
            index = int(number) - 1 if number else None
            self._workspace.selection = dataclasses.replace(self._shown[1], index=index)

    def _set_width(self, width: float, key: object) -> None:
        if self._shown is not None:
            changed = widened(self._document.sketch, self._shown[1], width)
            self._document.do(f"Set the width of {name_of(*self._shown)}", changed, merge=key)

    def _move(self, x: float, y: float, key: object) -> None:
        if self._shown is not None:
            changed = point_moved(self._document.sketch, *self._shown, x, y)
            self._pending = (*self._shown, x, y)
            self._document.do(f"Move a point of {name_of(*self._shown)}", changed, merge=key)


class LakeForm(QWidget):
    """Level and depth of a lake."""

    def __init__(self) -> None:
        super().__init__()
        self.layer, self.label, self.line = "lake", 1, ""
        self._text = faint_label()
        column(self, self._text)

    def show_selection(self, placed: Placement, selection: Selection) -> None:
        lake = find_lake(placed, selection)
        if lake is None:
            return
        self.label = max(lake.label, 1)  # 0: not painted but filled by a river
        self.line = f"painted with label {lake.label}" if lake.label else "filled by a river"
        self._text.setText(
            f"Water level: {number(lake.level, decimals=1)} m, as high as its rim allows. "
            f"Depth: {number(lake.depth, decimals=1)} m."
        )
