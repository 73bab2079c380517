"""A placed point feature: where it stands, how wide it is, how strong."""

from __future__ import annotations

import dataclasses

import numpy as np
from PyQt6.QtWidgets import QVBoxLayout, QWidget

from sketchterrain.features.catalogue import FILL_BIT
from sketchterrain.sketch import ACTIONS, ADDED_BIT, Sketch
from sketchterrain.ui.commands.chosen_parts import name_of, point_of
from sketchterrain.ui.commands.placed_edits import moved, resized, strength_of, strengthened
from sketchterrain.ui.engine.protocol import Placed
from sketchterrain.ui.look.theme import SPACING
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Chosen
from sketchterrain.ui.panels.number_row import NumberRow

_SHAPE = ACTIONS["add"].needs
_HEIGHT = dataclasses.replace(_SHAPE["strength"], name="height", low=0.0, unit="m", help="from foot to top")
_SHARE = dataclasses.replace(
    _SHAPE["strength"], name="density", high=1.0, help="share of the trees that the ground can carry"
)
_RADIUS = dataclasses.replace(_SHAPE["radius"], help="how far it reaches from its middle")
_X = dataclasses.replace(_SHAPE["x"], help="east of the sketch's south-west corner")
_Y = dataclasses.replace(_SHAPE["y"], help="north of the sketch's south-west corner")


class FeatureForm(QWidget):
    """Numbers of a feature; each that is set is kept as an edit of it."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._placed: Placed | None = None
        self._chosen: Chosen | None = None
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

    def show_chosen(self, placed: Placed, chosen: Chosen) -> None:
        """Show a feature that is there."""
        point = point_of(placed, chosen)
        if point is None:
            return
        if chosen != self._chosen:
            for row in self.rows.values():
                row.finish()  # what was typed belongs to the feature that it was typed for
        self._placed, self._chosen = placed, chosen
        self.layer, self.line = name_of(placed, chosen), _line(chosen.id)
        self._show_spans()
        values = self._values(point)
        for name, row in self.rows.items():
            row.show_value(values[name])
        self.rows["height"].setVisible(self.layer != "forest")
        self.rows["density"].setVisible(self.layer == "forest")

    def _values(self, point: np.void) -> dict[str, float]:
        sketch = self._document.sketch
        chosen, placed = self._chosen, self._placed
        strength = strength_of(sketch, placed, chosen) if placed is not None and chosen is not None else None
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
        placed, chosen = self._placed, self._chosen
        if placed is None or chosen is None:
            return
        sketch = self._document.sketch
        kind = name_of(placed, chosen)
        if name in ("x", "y"):
            at = {each: self.rows[each].number for each in ("x", "y")} | {name: value}
            self._document.do(f"Move {kind}", moved(sketch, placed, chosen, at["x"], at["y"]), merge=key)
        elif name == "radius":
            self._document.do(f"Resize {kind}", resized(sketch, placed, chosen, value), merge=key)
        else:
            changed = strengthened(sketch, placed, chosen, value)
            self._document.do(f"Set {name} of {kind}", changed, merge=key)


def _line(feature: int) -> str:
    if feature & ADDED_BIT and not feature & int(FILL_BIT):
        return "added by hand"
    return "placed in unpainted land" if feature & int(FILL_BIT) else "placed where it was painted"
