"""The dialog for a world: what of it, what it will take, how far it is, and what came of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from PyQt6.QtCore import QTimer, QUrl, pyqtSignal
from PyQt6.QtGui import QCloseEvent, QDesktopServices
from PyQt6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QLabel,
    QLineEdit,
    QWidget,
)

from sketchterrain.app.estimates import format_duration
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.io.files import format_bytes
from sketchterrain.ui.dialogs.form import (
    Field,
    Form,
    Line,
    add_button,
    column,
    heading,
    note,
    only_close,
    part,
    progress_bar,
    show_note,
    titled,
)
from sketchterrain.ui.export_job import ExportJob
from sketchterrain.ui.export_request import WorldRequest
from sketchterrain.ui.models.preferences import Preferences
from sketchterrain.world.grid import LAYERS
from sketchterrain.world.job import ENDINGS
from sketchterrain.world.options import WorldOptions, form_of

_FAR: Final = (-1e9, 1e9)
_FORMS: Final = {
    "zarr": "Zarr store (.zarr)",
    "tiles": "Folder of GeoTIFF tiles",
    "tif": "One GeoTIFF a layer (.tif)",
}
_PLANTS: Final = {"none": "None", "parquet": "GeoParquet", "flatgeobuf": "FlatGeobuf"}
_STEPS: Final = {0.0: "Every bit", 2.0**-10: "1 mm (1/1024 m)", 2.0**-7: "8 mm (1/128 m)", 0.125: "1/8 m"}
_KEPT: Final = "world"
"""What preferences call what was asked for."""
_UNITS: Final = 1000
_NOTES: Final = 4


def _metres(name: str, title: str, default: float = 0.0) -> Field:
    return Field(name, title, default, range=_FAR, unit="m", width=104)


class WorldForm(Form):
    """Asks for a world; `problem` says why it cannot be written so."""

    def __init__(self, sketch: Sketch, kept: Mapping[str, object], parent: QWidget | None = None) -> None:
        self._sketch = sketch
        self.problem = ""
        east, north = (math.ceil(side) for side in sketch.size)
        from_corner = "Metres from the sketch's south-west corner"
        super().__init__(
            Field(
                "place",
                "&Place",
                "sketch",
                "The world goes on beyond the sketch",
                choices={"sketch": "The sketch's rectangle", "other": "Another rectangle"},
            ),
            Line(
                "across",
                "",
                from_corner,
                (_metres("west", "Western edge"), "to", _metres("east", "Eastern edge", east), "east"),
            ),
            Line(
                "up",
                "",
                from_corner,
                (_metres("south", "Southern edge"), "to", _metres("north", "Northern edge", north), "north"),
            ),
            Field(
                "cell",
                "&Cell",
                1.0,
                "Metres between vertices of the finest level",
                range=(0.001, 1e6),
                unit="m",
            ),
            Field(
                "form",
                "F&orm",
                "zarr",
                "What is written: all of them have coarser levels too",
                choices=_FORMS,
            ),
            Line(
                "layers",
                "&Layers",
                "Heights are always there",
                (
                    "Heights,",
                    Field("normals", "", True, words="Normals"),
                    Field("materials", "", True, words="Materials"),
                ),
            ),
            Field("steps", "&Heights to", 0.0, "Rounded heights take less room on the disk", choices=_STEPS),
            Line(
                "plant_files",
                "Pla&nts",
                "Where each one stands: they can be the largest part",
                (
                    Field("plants", "As what plants are written", "none", choices=_PLANTS),
                    Field("grass", "", False, words="With grass, flowers and ferns"),
                ),
            ),
            Field(
                "crs",
                "C&RS",
                "",
                "Coordinate reference system in metres, where the world shall lie",
                words="None, or EPSG:25832",
            ),
            Line(
                "origin",
                "Corner &at",
                "Where the sketch's south-west corner lies in it",
                (
                    _metres("easting", "Easting of the corner"),
                    "east,",
                    _metres("northing", "Northing of the corner"),
                    "north",
                ),
            ),
            Field(
                "workers",
                "&Workers",
                0,
                "Processes of this machine that share the work",
                range=(0, 256),
                decimals=0,
                words="One process",
                width=110,
            ),
            parent=parent,
        )
        self.changed.connect(self.check)
        self.set_values(kept)

    def options(self) -> WorldOptions:
        """Return what is asked for, unchecked."""
        values = self.values
        bounds = (values["west"], values["south"], values["east"], values["north"])
        off = {"normal": values["normals"], "materials": values["materials"]}
        return WorldOptions(
            bounds=bounds if values["place"] == "other" else None,
            cell=values["cell"],
            layers=tuple(name for name in LAYERS if off.get(name, True)),
            plants=values["plants"],
            grass=values["grass"] and values["plants"] != "none",
            crs=values["crs"].strip() or None,
            origin=(values["easting"], values["northing"]),
            step=values["steps"],
            workers=values["workers"] > 0,
        )

    def check(self) -> None:
        """Find out whether it can be written, and show what it is."""
        values = self.values
        self.show_lines(dict.fromkeys(("across", "up"), values["place"] == "other"))
        self.enable(values["plants"] != "none", "grass")
        self.enable(bool(values["crs"].strip()), "easting", "northing")
        self.problem, told = "", ""
        try:
            world = self.options().check(self._sketch)
            finest = world.levels[0]
            told = (
                f"{finest.columns} × {finest.rows} vertices, {world.vertices / 1e6:.4g} million on all "
                f"{len(world.levels)} levels."
            )
        except SketchterrainError as error:
            self.problem = one_line(error)
        self.note.setText(told)


class WorldDialog(QDialog):
    """Writes the world of a sketch as it is now: what it will take is asked for first, then it begins."""

    view_requested = pyqtSignal(object)
    """The written world at a path shall be shown."""

    def __init__(
        self,
        sketch: Sketch,
        preferences: Preferences,
        parent: QWidget | None = None,
        *,
        view: Callable[[Path], object] | None = None,
    ) -> None:
        super().__init__(parent)
        if view is not None:
            self.view_requested.connect(view)
        self._sketch = sketch
        self._preferences = preferences
        self.job: ExportJob | None = None
        self._is_estimated = False
        self._notes: list[str] = []
        rows = column(self, "Write world")
        self.form = WorldForm(sketch, preferences.export_options(_KEPT))
        folder = preferences.export_folder
        usual = (preferences.last_folder if folder is None else folder.parent) / "world"
        self.output = QLineEdit(f"{usual}{ENDINGS[self.form.values['form']]}")
        self.asking, self.working = self._ask_page(), self._work_page()
        for page in (self.asking, self.working):
            rows.addWidget(page, 1)
        buttons, roles = QDialogButtonBox(), QDialogButtonBox.ButtonRole
        self.go = add_button(buttons, "Estimate", roles.AcceptRole, self._begin)
        self.view = add_button(buttons, "View", roles.ActionRole, self._view)
        self.show_folder = add_button(buttons, "Open folder", roles.ActionRole, self._open_folder)
        self.close_ = add_button(buttons, "Cancel", roles.RejectRole, self.reject)
        self.view.hide()
        self.show_folder.hide()
        rows.addWidget(buttons)
        self.form.changed.connect(self._check)
        self.form["form"].currentIndexChanged.connect(self._end_as_form)
        self.output.textChanged.connect(self._check)
        self.setMinimumWidth(620)
        self._check()

    @property
    def place(self) -> Path:
        """The output that is chosen."""
        return Path(self.output.text().strip()).expanduser()

    def reject(self) -> None:
        """Cancel what runs; else close."""
        if self.job is not None and self.job.is_running:
            self.close_.setEnabled(False)
            self.doing.setText("Ends once what is begun is written …")
            self.job.cancel()
            return
        super().reject()

    def closeEvent(self, event: QCloseEvent | None) -> None:
        """Cancel what runs."""
        if self.job is not None:
            self.job.stop()
        super().closeEvent(event)

    def _ask_page(self) -> QWidget:
        page = QWidget()
        rows = part(page)
        rows.addWidget(self.form)
        rows.addLayout(titled("O&utput", self.output, "File or folder of the world", self._browse))
        self.told = note(selectable=True)
        rows.addWidget(self.told)
        rows.addStretch(1)
        return page

    def _work_page(self) -> QWidget:
        page = QWidget()
        rows = part(page)
        self._head, self.doing, self.noted = (
            heading("Writing the world"),
            QLabel("Starting"),
            note(selectable=True),
        )
        self.doing.setWordWrap(True)
        self.bar = progress_bar("How far the world is", _UNITS)
        for widget in (self._head, self.doing, self.bar, self.noted):
            rows.addWidget(widget)
        rows.addStretch(1)
        return page

    def _end_as_form(self) -> None:
        """Give the output's name the ending of the form that is chosen."""
        text = self.output.text().strip().rstrip("/")
        if text:
            path = Path(text)
            known = path.suffix.lower() in (".zarr", ".tif", ".tiff")
            self.output.setText(
                f"{path.with_suffix('') if known else path}{ENDINGS[self.form.values['form']]}"
            )

    def _check(self, *_: object) -> None:
        """Say what cannot be; an estimate holds only for what it was made of."""
        line = self.form.problem or self._problem_of_output()
        self._is_estimated = False
        self.go.setText("Estimate")
        self.go.setEnabled(not line)
        self.go.setDefault(True)
        show_note(self.told, line, is_wrong=bool(line))
        self._turn_to(self.asking)

    def _problem_of_output(self) -> str:
        text = self.output.text().strip()
        if not text:
            return "Choose a file or a folder."
        try:
            form = form_of(text)
        except InputError as error:
            return one_line(error)
        if form != self.form.values["form"]:
            ending = ENDINGS[self.form.values["form"]] or "no ending"
            return f"This form's name has {ending}: expected another name, or another form."
        return ""

    def _turn_to(self, page: QWidget) -> None:
        """Show a page, and be as high as it needs."""
        for each in (self.asking, self.working):
            each.setVisible(each is page)
        QTimer.singleShot(0, lambda: self.resize(self.width(), self.sizeHint().height()))

    def _browse(self) -> None:
        start = str(self.place)
        if self.form.values["form"] == "tif":
            name, _ = QFileDialog.getSaveFileName(self, "Write the world as", start, "GeoTIFF (*.tif)")
        else:
            name = QFileDialog.getExistingDirectory(
                self, "Write the world into a folder", str(self.place.parent)
            )
            if name and self.form.values["form"] == "zarr" and not name.endswith(".zarr"):
                name = str(Path(name) / "world.zarr")
        if name:
            self.output.setText(name)

    def _begin(self) -> None:
        """Sample what the world will take; once that is told, write it."""
        self._preferences.set_export_options(_KEPT, self.form.values)
        only_estimate = not self._is_estimated
        output, device = self.place.absolute(), self._preferences.device
        workers = self.form.values["workers"]
        request = WorldRequest(output, self.form.options(), workers, device, only_estimate)
        self.job = job = ExportJob(request, self._sketch, self)
        self._notes = []
        self.noted.clear()
        self.bar.setValue(0)
        self._head.setText("What it will take" if only_estimate else "Writing the world")
        self._turn_to(self.working)
        self.go.hide()
        self.close_.setText("Cancel")
        job.stage_changed.connect(self._show_stage)
        job.share_changed.connect(lambda share: self.bar.setValue(round(_UNITS * share)))
        job.noted.connect(self._note)
        job.finished.connect(self._show_estimate if only_estimate else self._show_done)
        job.failed.connect(self._show_not_estimated if only_estimate else self._show_failed)
        job.start()

    def _show_stage(self, title: str) -> None:
        self.doing.setText(title)

    def _note(self, line: str) -> None:
        self._notes.append(line)
        self.noted.setText("\n".join(self._notes[-_NOTES:]))

    def _show_estimate(self, told: dict[str, Any]) -> None:
        lines = [line[:1].upper() + line[1:] for line in told["lines"]]
        self._is_estimated = not told["problem"]
        self.go.setEnabled(self._is_estimated)
        if told["problem"]:
            show_note(self.told, "\n".join([*lines, told["problem"]]), is_wrong=True)
        else:
            done, tasks = told["done"], told["tasks"]
            self.go.setText("Start" if not done else "Go on" if done < tasks else "Verify")
            show_note(self.told, "\n".join(lines))
        self._ask_again()

    def _show_not_estimated(self, line: str) -> None:
        show_note(self.told, line, is_wrong=True)
        self._ask_again()

    def _ask_again(self) -> None:
        self._turn_to(self.asking)
        self.go.show()
        self.close_.setEnabled(True)
        self.go.setDefault(True)

    def _show_done(self, told: dict[str, Any]) -> None:
        self._head.setText("Written" if told["made"] else "All of it was there")
        self.bar.setValue(_UNITS)
        self.doing.setText(
            f"{told['made']} of {told['tasks']} shards in {format_duration(told['seconds'])}, "
            f"{told['files']} files, {format_bytes(told['bytes'])}, into\n{self.place}"
        )
        self.view.show()
        self._finish()

    def _show_failed(self, line: str) -> None:
        self._head.setText("Not written" if line else "Cancelled")
        self.doing.setText("What is written stays: the same world at the same output goes on from there.")
        self.noted.setText("\n".join([*self._notes[-_NOTES:], line]).strip())
        self._finish()

    def _finish(self) -> None:
        self.show_folder.show()
        only_close(self.close_)

    def _view(self) -> None:
        self.view_requested.emit(self.place)

    def _open_folder(self) -> None:
        folder = self.place if self.place.is_dir() else self.place.parent
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))
