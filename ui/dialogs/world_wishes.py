"""Which world shall be written, as controls: the command line's choices, with what they mean at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from PyQt6.QtCore import pyqtSignal
from PyQt6.QtWidgets import QCheckBox, QComboBox, QLineEdit, QWidget

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.sketch import Sketch
from sketchterrain.ui.dialogs.kept_controls import Kept, call_on_change, set_values, values_of
from sketchterrain.ui.dialogs.sheet import add_rows, beside, choice_box, form, note, part
from sketchterrain.ui.export_wish import WorldWish
from sketchterrain.ui.panels.numbers import NumberBox
from sketchterrain.world.ground import LAYERS
from sketchterrain.world.options import WorldOptions

"""What the output's name ends in, by form."""
_FORMS: Final = {
    "zarr": "Zarr store (.zarr)",
    "tiles": "Folder of GeoTIFF tiles",
    "tif": "One GeoTIFF a layer (.tif)",
}
_PLANTS: Final = {"none": "None", "parquet": "GeoParquet", "flatgeobuf": "FlatGeobuf"}
_STEPS: Final = {0.0: "Every bit", 2.0**-10: "1 mm (1/1024 m)", 2.0**-7: "8 mm (1/128 m)", 0.125: "1/8 m"}
_FAR: Final = 1e9  # m
_FINEST, _COARSEST = 0.001, 1e6  # m
_MOST_WORKERS: Final = 256


class WorldWishes(QWidget):
    """Asks for a world."""

    changed = pyqtSignal()

    def __init__(
        self, sketch: Sketch, kept: Mapping[str, object] | None = None, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._sketch = sketch
        self.problem = ""
        self.whole = QComboBox()
        self.whole.addItem("The sketch's rectangle", "sketch")
        self.whole.addItem("Another rectangle", "other")
        east, north = sketch.size
        self.west, self.south, self.east, self.north = (
            _metres(value) for value in (0.0, 0.0, math.ceil(east), math.ceil(north))
        )
        self.cell = NumberBox(_FINEST, _COARSEST, suffix=" m")
        self.cell.setValue(1.0)
        self.forms, self.plants, self.steps = (choice_box(each) for each in (_FORMS, _PLANTS, _STEPS))
        self.normals, self.materials = QCheckBox("Normals"), QCheckBox("Materials")
        for layer in (self.normals, self.materials):
            layer.setChecked(True)
        self.grass = QCheckBox("With grass, flowers and ferns")
        self.crs, self.easting, self.northing = QLineEdit(), _metres(0.0), _metres(0.0)
        self.crs.setPlaceholderText("None, or EPSG:25832")
        self.workers = NumberBox(0, _MOST_WORKERS, decimals=0)
        self.workers.setSpecialValueText("One process")
        self._told = note()
        self._lay_out()
        self._controls: dict[str, QWidget] = {
            "place": self.whole,
            "west": self.west,
            "south": self.south,
            "east": self.east,
            "north": self.north,
            "cell": self.cell,
            "form": self.forms,
            "normals": self.normals,
            "materials": self.materials,
            "steps": self.steps,
            "plants": self.plants,
            "grass": self.grass,
            "crs": self.crs,
            "easting": self.easting,
            "northing": self.northing,
            "workers": self.workers,
        }
        set_values(self._controls, kept or {})
        call_on_change(self._controls, self.check)
        self.check()

    @property
    def form(self) -> str:
        """``zarr``, ``tiles`` or ``tif``."""
        return str(self.forms.currentData())

    def kept(self) -> Kept:
        """Return what is set, to be kept."""
        return values_of(self._controls)

    def wishes(self) -> WorldOptions:
        """Return what is asked for, unchecked."""
        bounds = tuple(box.value() for box in (self.west, self.south, self.east, self.north))
        off = {"normal": self.normals, "materials": self.materials}
        plants: Any = self.plants.currentData()
        return WorldOptions(
            bounds=bounds if self._is_other else None,  # type: ignore[arg-type]  # four of them
            cell=self.cell.value(),
            layers=tuple(name for name in LAYERS if name not in off or off[name].isChecked()),
            plants=plants,
            grass=self.grass.isChecked() and plants != "none",
            crs=self.crs.text().strip() or None,
            origin=(self.easting.value(), self.northing.value()),
            step=float(self.steps.currentData()),
            workers=self.workers.value() > 0,
        )

    def wish(self, output: Path, device: str | None, *, only_estimate: bool) -> WorldWish:
        """Return what is asked for, at an output, on a device."""
        return WorldWish(output, self.wishes(), int(self.workers.value()), device, only_estimate)

    def check(self, *_: object) -> None:
        """Find out whether it can be meant, and tell what it is."""
        for row in self._bounds:
            self._fields.setRowVisible(row, self._is_other)
        self.grass.setEnabled(self.plants.currentData() != "none")
        for box in (self.easting, self.northing):
            box.setEnabled(bool(self.crs.text().strip()))
        self.problem, told = "", ""
        try:
            world = self.wishes().check(self._sketch)
            finest = world.levels[0]
            told = (
                f"{finest.columns} × {finest.rows} vertices, {world.vertices / 1e6:.4g} million on all "
                f"{len(world.levels)} levels."
            )
        except SketchterrainError as error:
            self.problem = one_line(error)
        self._told.setText(told)
        self.changed.emit()

    @property
    def _is_other(self) -> bool:
        return bool(self.whole.currentData() == "other")

    def _lay_out(self) -> None:
        rows = part(self)
        self._fields = form()
        self._bounds = (
            beside(self.west, "to", self.east, "east"),
            beside(self.south, "to", self.north, "north"),
        )
        layers = beside("Heights,", self.normals, self.materials)
        plants = beside(self.plants, self.grass)
        corner = beside(self.easting, "east,", self.northing, "north")
        controls: tuple[tuple[str, QWidget, str], ...] = (
            ("&Place", self.whole, "The world goes on beyond the sketch"),
            ("", self._bounds[0], "Metres from the sketch's south-west corner"),
            ("", self._bounds[1], "Metres from the sketch's south-west corner"),
            ("&Cell", self.cell, "Metres between vertices of the finest level"),
            ("F&orm", self.forms, "What is written: all of them have coarser levels too"),
            ("&Layers", layers, "Heights are always there"),
            ("&Heights to", self.steps, "Rounded heights take less room on the disk"),
            ("Pla&nts", plants, "Where each one stands: they can be the largest part"),
            ("C&RS", self.crs, "Coordinate reference system in metres, where the world shall lie"),
            ("Corner &at", corner, "Where the sketch's south-west corner lies in it"),
            ("&Workers", self.workers, "Processes of this machine that share the work"),
        )
        add_rows(self._fields, controls)
        for control, name in (
            (self._bounds[0], "From west to east"),
            (self._bounds[1], "From south to north"),
            (self.west, "Western edge"),
            (self.south, "Southern edge"),
            (self.east, "Eastern edge"),
            (self.north, "Northern edge"),
            (self.plants, "As what plants are written"),
            (self.easting, "Easting of the corner"),
            (self.northing, "Northing of the corner"),
        ):
            control.setAccessibleName(name)
        rows.addLayout(self._fields)
        rows.addWidget(self._told)


def _metres(value: float) -> NumberBox:
    box = NumberBox(-_FAR, _FAR, suffix=" m")
    box.setFixedWidth(104)
    box.setValue(value)
    return box
