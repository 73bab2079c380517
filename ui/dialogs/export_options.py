"""What can be asked of an export to a target, as controls: only those that the target heeds are shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from PyQt6.QtCore import pyqtSignal
from PyQt6.QtGui import QIntValidator
from PyQt6.QtWidgets import QCheckBox, QComboBox, QLabel, QLineEdit, QVBoxLayout, QWidget

from sketchterrain.errors import InputError
from sketchterrain.export.planning import option_names
from sketchterrain.export.target import ExportOptions, Target
from sketchterrain.export.tiling import Tiling
from sketchterrain.ui.dialogs.kept_controls import Kept, set_values, values_of
from sketchterrain.ui.dialogs.sheet import beside, form
from sketchterrain.ui.panels.numbers import NumberBox

_SIZES: Final = (257, 513, 1025, 2049, 4097, 8193)
_FORMATS: Final = {
    "png": "PNG, 16 bits",
    "exr": "OpenEXR, metres as float32",
    "r16": "R16, 16-bit numbers",
    "r16be": "R16, 16-bit numbers, big-endian",
    "r32": "R32, metres as float32",
    "glb": "GLB",
    "ply": "PLY",
}
_MOST_TILES = 64  # along a side
_FAR = 1e8  # m: no coordinates of a map lie farther out
_RANGE = (0.0, 2000.0)  # m: what a person begins with who wants a range
_TILE_OPTIONS = ("overlap", "tile_name", "tile_first", "tiles_from_south")


class TargetControls(QWidget):
    """Size, tiles, format and so on of the target that is used."""

    changed = pyqtSignal()

    def __init__(self, *, is_wide: bool = True, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._is_wide = is_wide
        self._target: Target | None = None
        self._filling = False
        self.sizes, self.formats, self.counted = QComboBox(), QComboBox(), QComboBox()
        for from_south, title in ((False, "From the north"), (True, "From the south")):
            self.counted.addItem(title, from_south)
        self.columns, self.rows = _whole(1, _MOST_TILES), _whole(1, _MOST_TILES)
        self.overlap, self.first = _whole(0, 4096), _whole(0, 9999)
        self.pattern, self.crs = QLineEdit(), QLineEdit()
        self.crs.setPlaceholderText("None, or EPSG:25832")
        self.ranged = QCheckBox("Always")
        self.low, self.high = (NumberBox(-20_000.0, 20_000.0, suffix=" m") for _ in _RANGE)
        self.error = NumberBox(0.0, 1000.0, suffix=" m")
        self.error.setSpecialValueText("All vertices")
        self.error.setFixedWidth(128)
        self.east, self.north = (NumberBox(-_FAR, _FAR, suffix=" m") for _ in range(2))
        for box in (self.east, self.north):
            box.setFixedWidth(128)
        self.plants = QCheckBox("Trees and shrubs")
        self.grass = QCheckBox("Grass, flowers and ferns too (millions)")
        self._fields = form()
        self._rows: dict[str, QWidget] = {}
        self._lay_out()
        self._controls: dict[str, QWidget] = {
            "columns": self.columns,
            "rows": self.rows,
            "size": self.sizes,
            "overlap": self.overlap,
            "tile_name": self.pattern,
            "tile_first": self.first,
            "tiles_from_south": self.counted,
            "format": self.formats,
            "ranged": self.ranged,
            "low": self.low,
            "high": self.high,
            "error": self.error,
            "crs": self.crs,
            "east": self.east,
            "north": self.north,
            "plants": self.plants,
            "grass": self.grass,
        }
        self._connect()

    def use(self, target: Target, kept: Mapping[str, object]) -> None:
        """Show what a target heeds, as it was kept."""
        self._target = target
        self._filling = True
        tiling = target.tiling or Tiling()
        self._fill_sizes(target)
        self.formats.clear()
        for name in target.formats:
            self.formats.addItem(_FORMATS.get(name, name.upper()), name)
        usual: Kept = {
            "columns": 1,
            "rows": 1,
            "overlap": tiling.overlap,
            "tile_name": tiling.pattern,
            "tile_first": tiling.first,
            "ranged": False,
            "low": _RANGE[0],
            "high": _RANGE[1],
            "error": 0.0,
            "crs": "",
            "east": 0.0,
            "north": 0.0,
            "plants": True,
            "grass": False,
        }
        set_values(self._controls, usual)
        self.counted.setCurrentIndex(int(tiling.from_south))
        set_values(self._controls, kept)
        self._filling = False
        self._tell()

    def kept(self) -> Kept:
        """Return what is set, to be kept."""
        return values_of(self._controls)

    def options(self) -> ExportOptions:
        """Return what is asked for."""
        target = self._target
        if target is None:
            raise RuntimeError("expected a target to be used first")
        heeded = option_names(target)
        tiles = (int(self.columns.value()), int(self.rows.value()))
        given: dict[str, Any] = {"plants": self.plants.isChecked()}
        given["grass"] = self.grass.isChecked() and given["plants"]
        if "tiles" in heeded and tiles != (1, 1):
            of_tiles = {
                "overlap": int(self.overlap.value()),
                "tile_name": self.pattern.text(),
                "tile_first": int(self.first.value()),
                "tiles_from_south": bool(self.counted.currentData()),
            }
            given |= {"tiles": tiles} | {name: value for name, value in of_tiles.items() if name in heeded}
        others = {
            "format": self.formats.currentData(),
            "heights": (self.low.value(), self.high.value()) if self.ranged.isChecked() else None,
            "error": self.error.value() or None,
            "crs": self.crs.text().strip() or None,
            "origin": (self.east.value(), self.north.value()),
        }
        given |= {name: value for name, value in others.items() if name in heeded}
        if "size" in heeded:
            given["size"] = self._size(target, given)
        return replace(ExportOptions(), **given)

    def _size(self, target: Target, given: Mapping[str, Any]) -> int:
        """Return the vertices of the whole: where only some sides are taken, a tile's side is asked for."""
        if not target.sizes:
            text = self.sizes.currentText().strip()
            if not text.isdecimal():
                raise InputError(f"size {text!r}: expected a number of vertices")
            return int(text)
        columns, rows = given.get("tiles", (1, 1))
        side = int(self.sizes.currentData())
        tiling = Tiling(columns, rows, overlap=given.get("overlap", (target.tiling or Tiling()).overlap))
        if tiling.count > 1 and tiling.overlap >= side:
            raise InputError(f"tiles of {side} vertices cannot share {tiling.overlap}")
        return tiling.whole(side, max(columns, rows))

    def _fill_sizes(self, target: Target) -> None:
        self.sizes.clear()
        self.sizes.setEditable(not target.sizes)
        for side in target.sizes or sorted({*_SIZES, target.size}):
            self.sizes.addItem(f"{side} × {side}" if target.sizes else str(side), side)
        self.sizes.setCurrentIndex(self.sizes.findData(target.size))
        typed = self.sizes.lineEdit()
        if typed is not None:
            typed.setValidator(QIntValidator(2, 99_999, typed))
            typed.setAccessibleName("Vertices along the longer side")
            self.sizes.setEditText(str(target.size))
        label = self._fields.labelForField(self.sizes)
        if isinstance(label, QLabel):
            label.setText("&Size of a tile" if target.sizes else "&Size")
            label.setBuddy(self.sizes)

    def _offer_sizes(self, target: Target) -> None:
        """Offer sizes that can be cut into the tiles; one that was typed stays as it is."""
        if target.sizes or target.spacing is not None:
            return
        tiles = int((self.columns if self._is_wide else self.rows).value())
        tiling = Tiling(overlap=int(self.overlap.value()))
        sizes = sorted({*_SIZES, target.size})
        fitting = [min(tiling.nearest(size, tiles), key=lambda each: abs(each - size)) for size in sizes]
        if fitting == [self.sizes.itemData(row) for row in range(self.sizes.count())]:
            return
        text = self.sizes.currentText()
        chosen = self.sizes.findText(text)
        self.sizes.clear()
        for size in fitting:
            self.sizes.addItem(str(size), size)
        self.sizes.setEditText(text if chosen < 0 else str(fitting[chosen]))

    def _lay_out(self) -> None:
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.addLayout(self._fields)
        tiles = beside(self.columns, "×", self.rows)
        heights = beside(self.ranged, "from", self.low, "to", self.high)
        origin = beside(self.east, "east,", self.north, "north")
        for option, title, row, tip in (
            ("size", "&Size", self.sizes, "Vertices of heights, normals and materials"),
            ("tiles", "&Tiles", tiles, "Columns and rows of files"),
            ("overlap", "Shared &vertices", self.overlap, "That neighbouring tiles both have: 1 is an edge"),
            ("tile_name", "Na&mes", self.pattern, "With {name}, {x} and {y}; {x:02} has leading zeros"),
            ("tile_first", "First num&ber", self.first, "Of the first tile each way"),
            ("tiles_from_south", "&Rows counted", self.counted, "Which row of tiles has the first number"),
            ("format", "F&ormat", self.formats, "Of the heights"),
            (
                "heights",
                "&Heights",
                heights,
                "What 16 bits hold: the same range for many terrains fits together",
            ),
            ("error", "&Error at most", self.error, "Metres that the mesh may be off: fewer triangles"),
            ("crs", "&CRS", self.crs, "Coordinate reference system in metres, where the terrain shall lie"),
            ("origin", "Corner &at", origin, "Where the sketch's south-west corner lies in it"),
            ("plants", "&Plants", self.plants, "Where each one stands, how tall it is"),
            ("grass", "", self.grass, "Many: files become large"),
        ):
            self._fields.addRow(title, row)
            row.setToolTip(tip)
            row.setAccessibleName(title.replace("&", "") or "Grass")
            self._rows[option] = row
        for control, name in (
            (self.columns, "Columns of tiles"),
            (self.rows, "Rows of tiles"),
            (self.low, "Lowest height"),
            (self.high, "Highest height"),
            (self.east, "Easting of the corner"),
            (self.north, "Northing of the corner"),
        ):
            control.setAccessibleName(name)

    def _connect(self) -> None:
        for control in self._controls.values():
            if isinstance(control, QComboBox):
                control.currentTextChanged.connect(self._tell)
            elif isinstance(control, QCheckBox):
                control.toggled.connect(self._tell)
            elif isinstance(control, NumberBox):
                control.valueChanged.connect(self._tell)
            elif isinstance(control, QLineEdit):
                control.textChanged.connect(self._tell)

    def _tell(self, *_: object) -> None:
        if self._filling or self._target is None:
            return
        self._filling = True
        self._offer_sizes(self._target)
        self._filling = False
        heeded = option_names(self._target)
        cut = (self.columns.value(), self.rows.value()) != (1.0, 1.0)
        for option, row in self._rows.items():
            self._fields.setRowVisible(row, option in heeded and (cut or option not in _TILE_OPTIONS))
        for box in (self.low, self.high):
            box.setEnabled(self.ranged.isChecked())
        self.grass.setEnabled(self.plants.isChecked())
        self.changed.emit()


def _whole(low: int, high: int) -> NumberBox:
    return NumberBox(low, high, decimals=0)
