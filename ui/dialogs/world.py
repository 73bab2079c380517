"""World dialog: extent and options, estimate, progress and outcome."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from PyQt6.QtCore import QTimer
from PyQt6.QtWidgets import QFileDialog, QPushButton, QWidget

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.io.files import format_bytes
from sketchterrain.jobs.estimates import format_duration
from sketchterrain.ui.dialogs.form import Field, Form, JobDialog, JobProgress, Line, show_note, titled
from sketchterrain.ui.engine.protocol import WorldRequest
from sketchterrain.ui.look.theme import MARGIN, column
from sketchterrain.ui.models.workspace import Preferences
from sketchterrain.world.grid import LAYERS
from sketchterrain.world.job import ENDINGS
from sketchterrain.world.options import WorldOptions, output_form

_FAR: Final = (-1e9, 1e9)
_FORMS: Final = {
    "zarr": "Zarr store (.zarr)",
    "tiles": "Folder of GeoTIFF tiles",
    "tif": "One GeoTIFF a layer (.tif)",
}
_PLANTS: Final = {"none": "None", "parquet": "GeoParquet", "flatgeobuf": "FlatGeobuf"}
_STEPS: Final = {0.0: "Every bit", 2.0**-10: "1 mm (1/1024 m)", 2.0**-7: "8 mm (1/128 m)", 0.125: "1/8 m"}
_PREFERENCES_KEY: Final = "world"
_FROM_CORNER: Final = "Metres from the sketch's south-west corner"


def _metres(name: str, title: str, default: float = 0.0) -> Field:
    return Field(name, title, float(default), range=_FAR, unit="m", width=104)


def _fields(east: float, north: float) -> tuple[Field | Line, ...]:
    """Return the fields of a world, whose default extent is the sketch's size (m)."""
    places = {"sketch": "The sketch's rectangle", "other": "Another rectangle"}
    across = (_metres("west", "Western edge"), "to", _metres("east", "Eastern edge", east), "east")
    up = (_metres("south", "Southern edge"), "to", _metres("north", "Northern edge", north), "north")
    cell_tip = "Metres between vertices of the finest level"
    optional = [
        Field("normals", "", True, text="Normals"),
        Field("materials", "", True, text="Materials"),
        Field("appearance", "", False, "Colour of roads and land use", text="Appearance"),
    ]
    plants = Field("plants", "Format of plants", "none", choices=_PLANTS)
    grass = Field("grass", "", False, text="With grass, flowers and ferns")
    crs_tip = "Projected coordinate reference system of the world, in metres"
    corner = (
        *(_metres("easting", "Easting of the corner"), "east,"),
        *(_metres("northing", "Northing of the corner"), "north"),
    )
    workers_tip = "Processes of this machine that share the work"
    return (
        Field("place", "&Place", "sketch", "The world extends beyond the sketch", choices=places),
        Line("across", "", _FROM_CORNER, across),
        Line("up", "", _FROM_CORNER, up),
        Field("cell", "&Cell", 1.0, cell_tip, range=(0.001, 1e6), unit="m"),
        Field("form", "F&orm", "zarr", "Output format; all have overviews", choices=_FORMS),
        Line("layers", "&Layers", "Heights are always written", ("Heights,", *optional)),
        Field("steps", "&Heights to", 0.0, "Rounded heights compress better", choices=_STEPS),
        Line("plant_files", "Pla&nts", "Positions of plants, which can be the largest part", (plants, grass)),
        Field("crs", "C&RS", "", crs_tip, text="The sketch's, or EPSG:25832"),
        Line("origin", "Corner &at", "Position of the sketch's south-west corner", corner),
        Field("workers", "&Workers", 0, workers_tip, range=(0, 256), text="One process", width=110),
    )


class WorldForm(Form):
    """Options of a world; `problem` is why it cannot be written."""

    def __init__(self, sketch: Sketch, stored: Mapping[str, object]) -> None:
        self._sketch = sketch
        self.problem = ""
        super().__init__(*_fields(*(math.ceil(side) for side in sketch.size)))
        self.changed.connect(self.check)
        self.set_values(stored)

    def options(self) -> WorldOptions:
        """Return the options, unchecked."""
        values = self.values
        bounds = (values["west"], values["south"], values["east"], values["north"])
        optional = {"normal": values["normals"]} | {key: values[key] for key in ("materials", "appearance")}
        return WorldOptions(
            bounds=bounds if values["place"] == "other" else None,
            cell=values["cell"],
            layers=tuple(name for name in LAYERS if optional.get(name, True)),
            plants=values["plants"],
            grass=values["grass"] and values["plants"] != "none",
            crs=values["crs"].strip() or None,
            origin=(values["easting"], values["northing"]) if values["crs"].strip() else None,
            step=values["steps"],
            workers=values["workers"] > 0,
        )

    def check(self) -> None:
        """Check the options and show the size of the world."""
        values = self.values
        self.show_lines(dict.fromkeys(("across", "up"), values["place"] == "other"))
        self.enable(values["plants"] != "none", "grass")
        self.enable(bool(values["crs"].strip()), "easting", "northing")
        self.problem, text = "", ""
        try:
            world = self.options().check(self._sketch)
            finest = world.levels[0]
            text = (
                f"{finest.columns} × {finest.rows} vertices, {world.vertices / 1e6:.4g} million on all "
                f"{len(world.levels)} levels."
            )
        except SketchterrainError as error:
            self.problem = one_line(error)
        self.note.setText(text)


class WorldDialog(JobDialog):
    """Writes the world of a sketch as it is when the dialog opens, after an estimate."""

    cancelling = "Finishing pending shards …"

    def __init__(
        self,
        sketch: Sketch,
        preferences: Preferences,
        parent: QWidget | None = None,
        *,
        view: Callable[[Path], object] | None = None,
    ) -> None:
        self.progress = JobProgress("Writing the world", "Progress of the world")
        super().__init__("Write world", self.progress, sketch, preferences, parent)
        self._is_estimated = self._only_estimates = False
        self.form = WorldForm(sketch, preferences.export_options(_PREFERENCES_KEY))
        folder = preferences.export_folder
        stem = (preferences.last_folder if folder is None else folder.parent) / "world"
        self.path_field.setText(f"{stem}{ENDINGS[self.form.values['form']]}")
        self.options_page = QWidget()
        path = titled("O&utput", self.path_field, "File or folder of the world", self._browse)
        column(self.options_page, self.form, path, self.hint, 1, spacing=MARGIN)
        for page in (self.options_page, self.progress):
            self._column.addWidget(page, 1)
        self.view_button = QPushButton("View")
        if view is not None:
            self.view_button.clicked.connect(lambda: view(self.path))
        self.add_buttons("Estimate", self._start, self.view_button)
        self.form.changed.connect(self._check)
        self.form["form"].currentIndexChanged.connect(self._use_suffix)
        self.path_field.textChanged.connect(self._check)
        self.setMinimumWidth(620)
        self._check()

    def _use_suffix(self) -> None:
        """Give the output the suffix of the selected form."""
        text = self.path_field.text().strip().rstrip("/")
        if text:
            path = Path(text)
            stem = path.with_suffix("") if path.suffix.lower() in (".zarr", ".tif", ".tiff") else path
            self.path_field.setText(f"{stem}{ENDINGS[self.form.values['form']]}")

    def _check(self, *_: object) -> None:
        """Show errors; a changed option invalidates the estimate."""
        line = self.form.problem or self._path_error()
        self._is_estimated = False
        self.accept_button.setText("Estimate")
        self.accept_button.setEnabled(not line)
        self.accept_button.setDefault(True)
        show_note(self.hint, line, is_error=bool(line))
        self._show_page(self.options_page)

    def _path_error(self) -> str:
        text = self.path_field.text().strip()
        if not text:
            return "Choose a file or a folder."
        try:
            form = output_form(text)
        except InputError as error:
            return one_line(error)
        if form != self.form.values["form"]:
            suffix = ENDINGS[self.form.values["form"]] or "no suffix"
            return f"This form's name has {suffix}: expected another name, or another form."
        return ""

    def _show_page(self, page: QWidget) -> None:
        for each in (self.options_page, self.progress):
            each.setVisible(each is page)
        QTimer.singleShot(0, lambda: self.resize(self.width(), self.sizeHint().height()))

    def _browse(self) -> None:
        if self.form.values["form"] == "tif":
            start = str(self.path)
            name, _ = QFileDialog.getSaveFileName(self, "Write the world as", start, "GeoTIFF (*.tif)")
        else:
            start = str(self.path.parent)
            name = QFileDialog.getExistingDirectory(self, "Write the world into a folder", start)
            if name and self.form.values["form"] == "zarr" and not name.endswith(".zarr"):
                name = str(Path(name) / "world.zarr")
        if name:
            self.path_field.setText(name)

    def _start(self) -> None:
        """Estimate the world; once estimated, write it."""
        self._preferences.set_export_options(_PREFERENCES_KEY, self.form.values)
        self._only_estimates = not self._is_estimated
        output, device = self.path.absolute(), self._preferences.device
        workers = self.form.values["workers"]
        self.progress.lines.clear()
        self.progress.notes.clear()
        self.progress.bar.setValue(0)
        self.progress.heading.setText("Estimate" if self._only_estimates else "Writing the world")
        self._show_page(self.progress)
        self.close_button.setText("Cancel")
        self.run(WorldRequest(output, self.form.options(), workers, device, self._only_estimates))

    def _show_estimate(self, estimate: dict[str, Any]) -> None:
        lines = [line[:1].upper() + line[1:] for line in estimate["lines"]]
        problem, done, tasks = estimate["problem"], estimate["done"], estimate["tasks"]
        self._is_estimated = not problem
        self.accept_button.setEnabled(self._is_estimated)
        if not problem:
            self.accept_button.setText("Start" if not done else "Resume" if done < tasks else "Verify")
        show_note(self.hint, "\n".join([*lines, problem]).strip(), is_error=bool(problem))
        self._show_options()

    def _show_options(self) -> None:
        self._show_page(self.options_page)
        self.accept_button.show()
        self.close_button.setEnabled(True)
        self.accept_button.setDefault(True)

    def show_done(self, summary: dict[str, Any]) -> None:
        if self._only_estimates:
            self._show_estimate(summary)
            return
        self.progress.heading.setText("Written" if summary["made"] else "Already complete")
        self.progress.bar.setValue(JobProgress.UNITS)
        self.progress.doing.setText(
            f"{summary['made']} of {summary['tasks']} shards in {format_duration(summary['seconds'])}, "
            f"{summary['files']} files, {format_bytes(summary['bytes'])}, into\n{self.path}"
        )
        self.view_button.show()
        self.folder_button.show()
        self.finish()

    def show_failed(self, line: str) -> None:
        if self._only_estimates:
            show_note(self.hint, line, is_error=True)
            self._show_options()
            return
        self.progress.heading.setText("Not written" if line else "Cancelled")
        self.progress.doing.setText("Finished shards remain: the same world at the same output resumes.")
        self.progress.notes.setText(f"{self.progress.notes.text()}\n{line}".strip())
        self.folder_button.show()
        self.finish()
