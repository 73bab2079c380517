"""What an export is asked for, as forms: everything that `generate` writes, or one target's options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from PyQt6.QtGui import QIntValidator
from PyQt6.QtWidgets import QWidget

from sketchterrain.app.estimates import check_size, memory_needed
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.export.planning import ExportPlan, checked_plan, option_names
from sketchterrain.export.planning import memory_needed as memory_of_plan
from sketchterrain.export.sidecar import SIDECAR
from sketchterrain.export.target import ExportOptions, Target, Tiling
from sketchterrain.io.files import format_bytes
from sketchterrain.ui.dialogs.form import Field, Form, Line, note
from sketchterrain.ui.export_request import ExportRequest, TargetRequest

_SIZES: Final = (257, 513, 1025, 2049, 4097, 8193)
_FOLIAGE: Final = {
    "csv": "Trees and shrubs as a table (CSV)",
    "ply": "Trees and shrubs as a point cloud (PLY)",
    "both": "As a table and as a point cloud",
    "none": "None",
}
_MAPS: Final = {"": "None", "png": "As a picture (PNG)", "svg": "As vectors (SVG)"}
_VIEWS: Final = {
    "auto": "From the best place",
    "ground": "From near the ground",
    "hill": "From a hill",
    "air": "From the air",
    "": "None",
}
_FORMATS: Final = {
    "png": "PNG, 16 bits",
    "exr": "OpenEXR, metres as float32",
    "r16": "R16, 16-bit numbers",
    "r16be": "R16, 16-bit numbers, big-endian",
    "r32": "R32, metres as float32",
    "glb": "GLB",
    "ply": "PLY",
}
_GRASS: Final = Field(
    "grass", "", False, "Many: files become large", words="Grass, flowers and ferns too (millions)"
)
# Of a vertex: 4 of height.tif, 2 of height.png, 3 of normals, 8 of materials, compressed to about two thirds.
_DISK = 11
_TILE_OPTIONS = ("overlap", "tile_name", "tile_first", "tiles_from_south")
_TILES, _HEIGHTS, _FAR = (1, 64), (-20_000.0, 20_000.0), (-1e8, 1e8)
_TARGET_FIELDS: Final = (
    Field("size", "&Size", "", "Vertices of heights, normals and materials", choices={"": ""}),
    Line(
        "tiles",
        "&Tiles",
        "Columns and rows of files",
        (
            Field("columns", "Columns of tiles", 1, range=_TILES, decimals=0),
            "×",
            Field("rows", "Rows of tiles", 1, range=_TILES, decimals=0),
        ),
    ),
    Field(
        "overlap",
        "Shared &vertices",
        1,
        "That neighbouring tiles both have: 1 is an edge",
        range=(0, 4096),
        decimals=0,
    ),
    Field("tile_name", "Na&mes", "", "With {name}, {x} and {y}; {x:02} has leading zeros"),
    Field("tile_first", "First num&ber", 0, "Of the first tile each way", range=(0, 9999), decimals=0),
    Field(
        "tiles_from_south",
        "&Rows counted",
        False,
        "Which row of tiles has the first number",
        choices={False: "From the north", True: "From the south"},
    ),
    Field("format", "F&ormat", "", "Of the heights", choices={"": ""}),
    Line(
        "heights",
        "&Heights",
        "What 16 bits hold: the same range for many terrains fits together",
        (
            Field("ranged", "A fixed range of heights", False, words="Always"),
            "from",
            Field("low", "Lowest height", 0.0, range=_HEIGHTS, unit="m"),
            "to",
            Field("high", "Highest height", 2000.0, range=_HEIGHTS, unit="m"),
        ),
    ),
    Field(
        "error",
        "&Error at most",
        0.0,
        "Metres that the mesh may be off: fewer triangles",
        range=(0.0, 1000.0),
        unit="m",
        words="All vertices",
        width=128,
    ),
    Field(
        "crs",
        "&CRS",
        "",
        "Coordinate reference system in metres, where the terrain shall lie",
        words="None, or EPSG:25832",
    ),
    Line(
        "origin",
        "Corner &at",
        "Where the sketch's south-west corner lies in it",
        (
            Field("east", "Easting of the corner", 0.0, range=_FAR, unit="m", width=128),
            "east,",
            Field("north", "Northing of the corner", 0.0, range=_FAR, unit="m", width=128),
            "north",
        ),
    ),
    Field("plants", "&Plants", True, "Where each one stands, how tall it is", words="Trees and shrubs"),
    _GRASS,
)
_USUAL: Final = {
    field.name: field.default
    for line in _TARGET_FIELDS
    for field in ((line,) if isinstance(line, Field) else line.parts)
    if isinstance(field, Field) and field.name != "size"
}


class EverythingForm(Form):
    """Asks for the size and the files of an export of everything.

    `problem` says why it cannot be exported so; `mark` is the name of a file that an export leaves.
    """

    mark = "report.json"

    def __init__(self, sketch: Sketch, kept: Mapping[str, object], parent: QWidget | None = None) -> None:
        self._sketch = sketch
        self.problem = ""
        sizes = {size: self._size_text(size) for size in _SIZES}
        super().__init__(
            Field("size", "&Heights", 1025, "Samples of heights, normals and materials", choices=sizes),
            Field("plants", "&Plants", "csv", "Which file holds the plants", choices=_FOLIAGE),
            replace(_GRASS, tip="Only a point cloud holds so many"),
            Field("map", "&Map", "", "A topographic map", choices=_MAPS),
            Field("view", "Pre&view", "auto", "A rendered picture", choices=_VIEWS),
            parent=parent,
        )
        self.changed.connect(self._check)
        self.set_values(kept)

    def request(self, folder: Path, device: str | None) -> ExportRequest:
        """Return what is asked for, into a folder, on a device."""
        values = self.values
        return ExportRequest(
            folder,
            size=values["size"],
            foliage=values["plants"],
            grass=values["grass"] and self["grass"].isEnabled(),
            preview=bool(values["view"]),
            view=values["view"] or "auto",
            map=values["map"] or None,
            device=device,
        )

    def _size_text(self, size: int) -> str:
        east, north = self._sketch.size
        short = max(2, round((size - 1) * min(east, north) / max(east, north)) + 1)
        columns, rows = (size, short) if east >= north else (short, size)
        return f"{columns} × {rows}, {max(east, north) / (size - 1):.3g} m apart"

    def _check(self) -> None:
        values, self.problem = self.values, ""
        size = values["size"]
        try:
            check_size(self._sketch, size)
        except InputError as error:
            self.problem = str(error)
        self.enable(values["plants"] in ("ply", "both"), "grass")
        east, north = self._sketch.size
        disk = _DISK * size**2 * min(east, north) / max(east, north) / (1 << 20)
        room = format_bytes(disk * (1 << 20))
        plants = "" if values["plants"] == "none" else " without the plants"
        self.note.setText(
            f"height.tif, height.png, normal.png, materials.png and features.json: about {room}{plants}. "
            f"Takes about {format_bytes(memory_needed(self._sketch, size))} of memory."
        )


class TargetForm(Form):
    """Asks for what one target takes, and tells what its export will be."""

    mark = SIDECAR

    def __init__(self, sketch: Sketch, parent: QWidget | None = None) -> None:
        super().__init__(*_TARGET_FIELDS, parent=parent)
        self._head = note()
        self._down.insertWidget(0, self._head)
        self._sketch = sketch
        self._is_wide = sketch.size[0] >= sketch.size[1]
        self._target: Target | None = None
        self._options: ExportOptions | None = None
        self.problem = ""
        self.changed.connect(self._check)

    def use(self, target: Target, kept: Mapping[str, object]) -> None:
        """Show what a target takes, as it was kept."""
        self._target = target
        self._head.setText(f"{target.summary[:1].upper()}{target.summary[1:]}.")
        tiling = target.tiling or Tiling()
        self._is_filling = True
        self._offer_sides(target)
        self["format"].clear()
        for name in target.formats:
            self["format"].addItem(_FORMATS.get(name, name.upper()), name)
        usual = {
            "overlap": tiling.overlap,
            "tile_name": tiling.pattern,
            "tile_first": tiling.first,
            "tiles_from_south": tiling.from_south,
        }
        self.set_values(_USUAL, usual, kept)

    def request(self, folder: Path, device: str | None) -> TargetRequest:
        """Return what is asked for, into a folder, on a device."""
        if self._target is None or self._options is None:
            raise RuntimeError("expected options that can be exported")
        return TargetRequest(folder, self._target.name, self._options, device)

    def options(self) -> ExportOptions:
        """Return what is asked for; raises `InputError` for a size that is no number, or too many tiles."""
        target, values = self._target, self.values
        if target is None:
            raise RuntimeError("expected a target to be used first")
        taken = option_names(target)
        tiles = (values["columns"], values["rows"])
        given = {
            "format": values["format"],
            "heights": (values["low"], values["high"]) if values["ranged"] else None,
            "error": values["error"] or None,
            "crs": values["crs"].strip() or None,
            "origin": (values["east"], values["north"]),
        }
        if tiles != (1, 1):
            given |= {"tiles": tiles} | {name: values[name] for name in _TILE_OPTIONS}
        given = {name: value for name, value in given.items() if name in taken}
        given["plants"] = values["plants"]
        given["grass"] = values["grass"] and values["plants"]
        if "size" in taken:
            given["size"] = self._size(target, given)
        return replace(ExportOptions(), **given)

    def _size(self, target: Target, given: Mapping[str, Any]) -> int:
        """Return the vertices of the whole: where only some sides are taken, a tile's side is asked for."""
        if not target.sizes:
            text = self["size"].currentText().strip()
            if not text.isdecimal():
                raise InputError(f"size {text!r}: expected a number of vertices")
            return int(text)
        columns, rows = given.get("tiles", (1, 1))
        side = int(self["size"].currentData())
        tiling = Tiling(columns, rows, overlap=given.get("overlap", (target.tiling or Tiling()).overlap))
        if tiling.count > 1 and tiling.overlap >= side:
            raise InputError(f"tiles of {side} vertices cannot share {tiling.overlap}")
        return tiling.grid_side(side, max(columns, rows))

    def _offer_sides(self, target: Target) -> None:
        sizes = self["size"]
        sizes.clear()
        sizes.setEditable(not target.sizes)
        for side in target.sizes or sorted({*_SIZES, target.size}):
            sizes.addItem(f"{side} × {side}" if target.sizes else str(side), side)
        sizes.setCurrentIndex(sizes.findData(target.size))
        typed = sizes.lineEdit()
        if typed is not None:
            typed.setValidator(QIntValidator(2, 99_999, typed))
            typed.setAccessibleName("Vertices along the longer side")
            sizes.setEditText(str(target.size))
        label = self.title_label("size")
        if label is not None:
            label.setText("&Size of a tile" if target.sizes else "&Size")
            label.setBuddy(sizes)

    def _offer_fitting_sizes(self, target: Target) -> None:
        """Offer sizes that can be cut into the tiles; one that was typed stays as it is."""
        if target.sizes or target.spacing is not None:
            return
        box = self["size"]
        tiles = int(self["columns" if self._is_wide else "rows"].value())
        tiling = Tiling(overlap=int(self["overlap"].value()))
        sizes = sorted({*_SIZES, target.size})
        fitting = [
            min(tiling.nearest_sides(size, tiles), key=lambda each: abs(each - size)) for size in sizes
        ]
        if fitting == [box.itemData(row) for row in range(box.count())]:
            return
        text = box.currentText()
        chosen = box.findText(text)
        self._is_filling = True
        box.clear()
        for size in fitting:
            box.addItem(str(size), size)
        box.setEditText(text if chosen < 0 else str(fitting[chosen]))
        self._is_filling = False

    def _check(self) -> None:
        target = self._target
        if target is None:
            return
        self._offer_fitting_sizes(target)
        taken, values = option_names(target), self.values
        is_cut = (values["columns"], values["rows"]) != (1, 1)
        self.show_lines(
            {name: name in taken and (is_cut or name not in _TILE_OPTIONS) for name in self._lines}
        )
        self.enable(values["ranged"], "low", "high")
        self.enable(values["plants"], "grass")
        self.problem, self._options, told = "", None, ""
        try:
            self._options = self.options()
            told = plan_line(checked_plan(self._sketch, target.name, self._options), self._sketch)
        except SketchterrainError as error:
            self.problem = one_line(error)
        self.note.setText(told)


def plan_line(plan: ExportPlan, sketch: Sketch) -> str:
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
        f"Takes up to {format_bytes(disk)} of disk{plants} and about "
        f"{format_bytes(memory_of_plan(plan))} of memory."
    )
    return " ".join(lines)
