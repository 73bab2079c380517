"""Forms of export options: everything that `generate` writes, or one target's options."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtGui import QIntValidator

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.export.planning import ExportPlan, checked_plan, option_names
from sketchterrain.export.planning import memory_needed as memory_of_plan
from sketchterrain.export.target import SIDECAR, ExportOptions, Target, Tiling
from sketchterrain.io.files import format_bytes
from sketchterrain.jobs.estimates import check_size, memory_needed
from sketchterrain.ui.dialogs.form import Field, Form, Line, note
from sketchterrain.ui.engine.protocol import ExportRequest, TargetRequest

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
    "layers": "Of the draped layers",
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
    "grass", "", False, "Many: files become large", text="Grass, flowers and ferns too (millions)"
)
# A vertex has 4 bytes of height.tif, 2 of height.png, 3 of normals, 8 of materials, compressed to 2/3.
_DISK = 11
_TILE_OPTIONS = ("overlap", "tile_name", "tile_first", "tiles_from_south")
_TILES, _HEIGHTS, _FAR = (1, 64), (-20_000.0, 20_000.0), (-1e8, 1e8)
_ROW_ORDERS: Final = {False: "From the north", True: "From the south"}


def _target_fields() -> tuple[Field | Line, ...]:
    tiles = (
        Field("columns", "Columns of tiles", 1, range=_TILES),
        Field("rows", "Rows of tiles", 1, range=_TILES),
    )
    overlap_tip = "Shared by neighbouring tiles: 1 is an edge"
    order_tip = "Which row of tiles has the first number"
    heights = (
        *(Field("ranged", "A fixed range of heights", False, text="Always"), "from"),
        *(Field("low", "Lowest height", 0.0, range=_HEIGHTS, unit="m"), "to"),
        Field("high", "Highest height", 2000.0, range=_HEIGHTS, unit="m"),
    )
    range_tip = "Range of 16-bit heights: terrains with the same range fit together"
    error_tip = "Greatest error of the mesh in metres: fewer triangles"
    crs_tip = "Projected coordinate reference system of the terrain, in metres"
    corner = (
        *(Field("east", "Easting of the corner", 0.0, range=_FAR, unit="m", width=128), "east,"),
        *(Field("north", "Northing of the corner", 0.0, range=_FAR, unit="m", width=128), "north"),
    )
    error = Field("error", "&Error at most", 0.0, error_tip, range=(0.0, 1000.0), unit="m", width=128)
    return (
        Field("size", "&Size", "", "Vertices of heights, normals and materials", choices={"": ""}),
        Line("tiles", "&Tiles", "Columns and rows of files", (tiles[0], "×", tiles[1])),
        Field("overlap", "Shared &vertices", 1, overlap_tip, range=(0, 4096)),
        Field("tile_name", "Na&mes", "", "With {name}, {x} and {y}; {x:02} has leading zeros"),
        Field("tile_first", "First num&ber", 0, "Of the first tile each way", range=(0, 9999)),
        Field("tiles_from_south", "&Rows counted", False, order_tip, choices=_ROW_ORDERS),
        Field("format", "F&ormat", "", "Of the heights", choices={"": ""}),
        Line("heights", "&Heights", range_tip, heights),
        replace(error, text="All vertices"),
        Field("crs", "&CRS", "", crs_tip, text="The sketch's, or EPSG:25832"),
        Line("origin", "Corner &at", "Position of the sketch's south-west corner", corner),
        Field("plants", "&Plants", True, "Positions and heights of plants", text="Trees and shrubs"),
        _GRASS,
    )


_TARGET_FIELDS: Final = _target_fields()
_DEFAULTS: Final = {
    field.name: field.default
    for line in _TARGET_FIELDS
    for field in (line.fields if isinstance(line, Line) else (line,))
    if field.name != "size"
}


class EverythingForm(Form):
    """Size and files of an export of everything.

    `problem` is why it cannot be exported; `mark` names a file that every export writes.
    """

    mark = "report.json"

    def __init__(self, sketch: Sketch, stored: Mapping[str, object]) -> None:
        self._sketch = sketch
        self.problem = ""
        sizes = {size: self._size_text(size) for size in _SIZES}
        super().__init__(
            Field("size", "&Heights", 1025, "Vertices of heights, normals and materials", choices=sizes),
            Field("plants", "&Plants", "csv", "File format of plants", choices=_FOLIAGE),
            replace(_GRASS, tip="Only a point cloud holds so many"),
            Field("map", "&Map", "", "A topographic map", choices=_MAPS),
            Field("view", "Pre&view", "auto", "A rendered picture", choices=_VIEWS),
        )
        self.changed.connect(self._check)
        self.set_values(stored)

    def request(self, folder: Path, device: str | None) -> ExportRequest:
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
        room = format_bytes(_DISK * size**2 * min(east, north) / max(east, north))
        plants = "" if values["plants"] == "none" else " without the plants"
        self.note.setText(
            f"height.tif, height.png, normal.png, materials.png and features.json: about {room}{plants}. "
            f"Takes about {format_bytes(memory_needed(self._sketch, size))} of memory."
        )


class TargetForm(Form):
    """Options of one target, and the plan of its export."""

    mark = SIDECAR

    def __init__(self, sketch: Sketch) -> None:
        super().__init__(*_TARGET_FIELDS)
        self._head = note()
        self._column.insertWidget(0, self._head)
        self._sketch = sketch
        self._is_wide = sketch.size[0] >= sketch.size[1]
        self._target: Target | None = None
        self._options: ExportOptions | None = None
        self.problem = ""
        self.changed.connect(self._check)

    def use(self, target: Target, stored: Mapping[str, object]) -> None:
        self._target = target
        self._head.setText(f"{target.summary[:1].upper()}{target.summary[1:]}.")
        tiling = target.tiling or Tiling()
        with QSignalBlocker(self):
            self._offer_sides(target)
            self["format"].clear()
            for name in target.formats:
                self["format"].addItem(_FORMATS.get(name, name.upper()), name)
        defaults = {
            "overlap": tiling.overlap,
            "tile_name": tiling.pattern,
            "tile_first": tiling.first,
            "tiles_from_south": tiling.from_south,
        }
        self.set_values(_DEFAULTS, defaults, stored)

    def request(self, folder: Path, device: str | None) -> TargetRequest:
        if self._target is None or self._options is None:
            raise RuntimeError("expected valid options")
        return TargetRequest(folder, self._target.name, self._options, device)

    def options(self) -> ExportOptions:
        """Return the options; raise `InputError` for an invalid size or too many tiles."""
        target, values = self._target, self.values
        if target is None:
            raise RuntimeError("expected a target to be used first")
        supported = option_names(target)
        tiles = (values["columns"], values["rows"])
        options = {
            "format": values["format"],
            "heights": (values["low"], values["high"]) if values["ranged"] else None,
            "error": values["error"] or None,
            "crs": values["crs"].strip() or None,
            "origin": (values["east"], values["north"]) if values["crs"].strip() else None,
        }
        if tiles != (1, 1):
            options |= {"tiles": tiles} | {name: values[name] for name in _TILE_OPTIONS}
        options = {name: value for name, value in options.items() if name in supported}
        options["plants"] = values["plants"]
        options["grass"] = values["grass"] and values["plants"]
        if "size" in supported:
            options["size"] = self._size(target, options)
        return replace(ExportOptions(), **options)

    def _size(self, target: Target, options: Mapping[str, Any]) -> int:
        """Return the vertices of the whole; targets with fixed sizes ask for the side of a tile."""
        if not target.sizes:
            text = self["size"].currentText().strip()
            if not text.isdecimal():
                raise InputError(f"size {text!r}: expected a number of vertices")
            return int(text)
        columns, rows = options.get("tiles", (1, 1))
        side = int(self["size"].currentData())
        tiling = Tiling(columns, rows, overlap=options.get("overlap", (target.tiling or Tiling()).overlap))
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
        editor = sizes.lineEdit()
        if editor is not None:
            editor.setValidator(QIntValidator(2, 99_999, editor))
            editor.setAccessibleName("Vertices along the longer side")
            sizes.setEditText(str(target.size))
        label = self.title_label("size")
        if label is not None:
            label.setText("&Size of a tile" if target.sizes else "&Size")
            label.setBuddy(sizes)

    def _offer_fitting_sizes(self, target: Target) -> None:
        """Offer sizes that divide into the tiles; a typed size stays."""
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
        selected = box.findText(text)
        with QSignalBlocker(self):
            box.clear()
            for size in fitting:
                box.addItem(str(size), size)
            box.setEditText(text if selected < 0 else str(fitting[selected]))

    def _check(self) -> None:
        target = self._target
        if target is None:
            return
        self._offer_fitting_sizes(target)
        supported, values = option_names(target), self.values
        is_cut = (values["columns"], values["rows"]) != (1, 1)
        self.show_lines(
            {name: name in supported and (is_cut or name not in _TILE_OPTIONS) for name in self._lines}
        )
        self.enable(values["ranged"], "low", "high")
        self.enable(values["plants"], "grass")
        self.problem, self._options, text = "", None, ""
        try:
            self._options = self.options()
            text = plan_line(checked_plan(self._sketch, target.name, self._options), self._sketch)
        except SketchterrainError as error:
            self.problem = one_line(error)
        self.note.setText(text)


def plan_line(plan: ExportPlan, sketch: Sketch) -> str:
    """Return a plan in words: vertices, tiles, extent, disk and memory."""
    grid, (columns, rows), tiles = plan.grid, plan.tile_side, plan.tiling.count
    across, up = grid.spacing
    apart = f"{across:.4g} m" if f"{across:.4g}" == f"{up:.4g}" else f"{across:.4g} m and {up:.4g} m"
    what = f"{tiles} tiles of {columns} × {rows}" if tiles > 1 else f"{columns} × {rows} vertices"
    lines = [f"{what}, {apart} apart."]
    width, height = grid.east - grid.west, grid.north - grid.south
    if width > sketch.size[0] + across / 2 or height > sketch.size[1] + up / 2:
        lines.append(f"{width:.0f} × {height:.0f} m: the terrain extends beyond the sketch.")
    disk = plan.target.disk * columns * rows * tiles
    plants = " besides the plants" if plan.options.plants else ""
    lines.append(
        f"Takes up to {format_bytes(disk)} of disk{plants} and about "
        f"{format_bytes(memory_of_plan(plan))} of memory."
    )
    return " ".join(lines)
