"""Opening, saving and exporting: files of the document and the dialogs that belong to them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

from PyQt6.QtCore import QObject, pyqtSignal
from PyQt6.QtWidgets import QApplication, QDialog, QFileDialog, QMessageBox, QWidget

from sketchterrain.document.label_layers import LabelImage, decode_layer
from sketchterrain.document.rasters import RasterSource, raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import CHANGED, Hashes, file_hashes, load_sketch
from sketchterrain.errors import InputError, SketchterrainError, prefix_errors
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.banner import Banner, Message, PictureFile
from sketchterrain.ui.commands import reported
from sketchterrain.ui.dialogs import help as help_dialogs
from sketchterrain.ui.dialogs.form import run_dialog
from sketchterrain.ui.dialogs.start import NewSketchDialog, PictureDialog, PresetsDialog
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import RenderPicture
from sketchterrain.ui.models.background import BackgroundReader, SketchSaver, single_shot
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.drapes import new_drape, with_layer
from sketchterrain.ui.models.workspace import Preferences, RecentFiles
from sketchterrain.ui.world_window import WorldWindow

if TYPE_CHECKING:
    from sketchterrain.importing.elevation import RasterArea


_T = TypeVar("_T")
_Button = QMessageBox.StandardButton
_TITLES = {_Button.SaveAll: "Save &as…", _Button.Yes: "&Overwrite", _Button.Reset: "&Reload"}
_MESSAGE_DELAY = 400  # ms of reading until a message is shown
_SUFFIX, _SETTINGS = ".sketch", "sketch.toml"
_OPEN_FILTER = f"Sketches (*{_SUFFIX} {_SETTINGS});;All files (*)"
_ONE_FILE, _FOLDER = f"Sketch in one file (*{_SUFFIX})", "Sketch as a folder of images (*)"
_VECTORS = "*.gpkg *.fgb *.geojson *.json *.shp *.gpx *.kml *.dxf *.osm *.pbf *.gz"
DRAPED = f"{_VECTORS} *.tif *.tiff *.vrt *.jp2 *.jpg *.webp"
_SAVED_FILTER = "GeoPackage (*.gpkg);;FlatGeobuf (*.fgb);;GeoJSON (*.geojson)"
_DRAPE_FILTER = f"Vectors and rasters ({DRAPED} *.png);;All files (*)"
_RASTERS = {  # roles
    "Picture beneath the paint (*)": "picture",
    "Orthophoto on the ground (*)": "orthophoto",
    "Elevation (*)": "elevation",
}


class Files(QObject):
    """Reads sketches into a document and saves them; failures become messages."""

    elevation_chosen = pyqtSignal(object)  # list of paths, to be added to the sketch
    drapes_read = pyqtSignal(object)  # list of draped layers, to be added too

    def __init__(
        self,
        window: QWidget,
        document: Document,
        preferences: Preferences,
        recent: RecentFiles,
        banner: Banner,
    ) -> None:
        super().__init__(window)
        self.window, self.document, self.banner = window, document, banner
        self.preferences, self.recent, self._saving = preferences, recent, SketchSaver(document)
        self._requested: Path | None = None
        self._reported: Hashes = {}  # of a change of the sketch's file
        self.reading = BackgroundReader(self)
        self.reading.failed.connect(self._report_read_error)
        self.reading.busy_changed.connect(self._show_reading)
        self._message_timer = single_shot(self, _MESSAGE_DELAY, self._show_reading_message)
        self._saving.saved.connect(self._remember)
        self._saving.failed.connect(self._report_save_error)
        self._saving.refused.connect(self._ask_overwrite)
        cast(QApplication, QApplication.instance()).focusWindowChanged.connect(self._report_change)

    def start_sketch(self, sketch: Sketch, *, modified: bool = False) -> bool:
        """Open an unsaved sketch unless the user keeps the current one; return whether it was opened."""
        if not self.confirm_close():
            return False
        self.document.open(sketch, modified=modified)
        self.banner.withdraw("file")
        return True

    def read(self, path: Path, work: Callable[[], _T], then: Callable[[_T], object]) -> None:
        """Run `work` in the background, then `then` with its result; messages meanwhile name `path`."""
        self._requested = path
        self.reading.read(work, partial(self._finish_reading, then))

    def _finish_reading(self, then: Callable[[_T], object], result: _T) -> None:
        self._requested = None
        self.banner.withdraw("file")
        then(result)

    def ask_files(self, title: str, kinds: str) -> list[Path]:
        """Ask for files of some kinds, none if cancelled, and remember their folder."""
        start = str(self.preferences.last_folder)
        names, _ = QFileDialog.getOpenFileNames(self.window, title, start, kinds)
        if names:
            self.preferences.last_folder = Path(names[0]).absolute().parent
        return [Path(name) for name in names]

    def ask_file(self, title: str, kinds: str) -> tuple[Path | None, str]:
        """Ask for a file of some kinds; return it, None if cancelled, and the chosen kind."""
        start = str(self.preferences.last_folder)
        name, kind = QFileDialog.getOpenFileName(self.window, title, start, kinds)
        return (Path(name) if name else None), kind

    def ask_open(self) -> None:
        path, _ = self.ask_file("Open a sketch", _OPEN_FILTER)
        if path:
            self.open(path)

    def ask_open_folder(self) -> None:
        start = str(self.preferences.last_folder)
        name = QFileDialog.getExistingDirectory(self.window, "Open a sketch's folder", start)
        if name:
            self.open(Path(name))

    def open(self, path: Path) -> None:
        """Open a sketch's folder, settings or file unless the user keeps the current one."""
        path = path.parent if path.name == _SETTINGS else path
        if self.confirm_close():
            self._open(path)

    def _open(self, path: Path) -> None:
        self.read(path, partial(_load, path), partial(self._show_sketch, path))

    def open_preset(self, name: str) -> None:
        """Open a preset unless the user keeps the current sketch."""
        if self.confirm_close():
            self.read(Path(name), lambda: (None, load_sketch(name)), partial(self._show_sketch, None))

    def save(self) -> bool:
        """Start saving the sketch at its path, or ask for one; return False if cancelled."""
        if self.document.path is None:
            return self.save_as()
        self._saving.save(self.document.path)
        return True

    def save_as(self) -> bool:
        """Ask for a path and start saving there; return False if cancelled."""
        path = self.document.path or self.preferences.last_folder / self._default_name()
        kind = _FOLDER if self.document.path and path.suffix.lower() != _SUFFIX else _ONE_FILE
        name, selected = QFileDialog.getSaveFileName(
            self.window, "Save the sketch", str(path), f"{_ONE_FILE};;{_FOLDER}", kind
        )
        if not name:
            return False
        path = Path(name)
        if selected != _FOLDER and path.suffix.lower() != _SUFFIX and not path.is_dir():
            path = path.with_name(path.name + _SUFFIX)
        self._saving.save(path)
        return True

    def confirm_close(self) -> bool:
        """Ask whether to save unsaved changes; return False if the sketch stays open."""
        draft = self.document.draft
        if draft is not None:
            draft.cancel()
        if not self.document.is_modified:
            return self._saving.wait() or not self._saving.is_busy
        question = f"Save the changes to “{self.document.sketch.name}”?"
        answer = self._ask(question, "Otherwise they are lost.", _Button.Save, _Button.Discard)
        if answer != _Button.Save:
            return answer == _Button.Discard
        return self.save() and self._saving.wait()

    def _report_change(self) -> None:
        """Report once that another program has changed the sketch's file, when the window gets the focus."""
        path, is_busy = self.document.path, self._saving.is_busy or self.reading.is_busy
        if path is None or is_busy or not self.window.isActiveWindow():
            return
        found = file_hashes(path)
        if found not in ({}, self.document.known_files.get(path, found), self._reported):
            self._reported = found
            buttons = (("Reload", partial(self.open, path)), ("Save as…", self.save_as))
            self.banner.show_message(Message("warning", f"{path.name} was {CHANGED}.", "file", buttons))

    def _ask_overwrite(self, path: Path) -> None:
        """Ask what to do about a file that another program has changed, instead of saving there."""
        lost = "Overwrite: its changes are lost. Reload: yours and the undo history are lost."
        answer = self._ask(f"{path.name} was {CHANGED}.", lost, *_TITLES)
        if answer == _Button.Yes:
            self.document.known_files[path] = file_hashes(path)
            self._saving.save(path)
        elif answer == _Button.SaveAll:
            self.save_as()
        elif answer == _Button.Reset:
            self._open(path)

    def _ask(self, question: str, consequence: str, *buttons: QMessageBox.StandardButton) -> int:
        """Return the answer to a question, Cancel if the box is closed; the first button is the default."""
        box = QMessageBox(QMessageBox.Icon.NoIcon, "Sketchterrain", question, _Button.Cancel, self.window)
        box.setInformativeText(consequence)
        for each in buttons:
            button = box.addButton(each)
            if button is not None and each in _TITLES:
                button.setText(_TITLES[each])
        box.setDefaultButton(buttons[0])
        answer = box.exec()
        box.deleteLater()
        return answer

    def ask_import(self, layer: str) -> None:
        """Ask for an image and import it into the layer of its file name, else into `layer`."""
        path, _ = self.ask_file("Import a layer", "Layer images (*.png)")
        if path:
            self.import_layers([path], layer)

    def import_layers(self, paths: Iterable[Path], layer: str) -> None:
        """Import images as layers in one undo step."""
        by_layer = {
            path.stem.lower() if path.stem.lower() in PAINTED_LAYERS else layer: path for path in paths
        }
        rows, columns = next(iter(self.document.sketch.layers.values())).shape

        def read() -> dict[str, tuple[LabelImage, list[str]]]:
            return {name: _layer_image(path, name, (rows, columns)) for name, path in by_layer.items()}

        self.reading.read(read, self._import)

    def ask_add_raster(self) -> None:
        """Ask for a raster file, and its role by the kind of file, and add it to the sketch."""
        path, kind = self.ask_file("Add a raster", ";;".join(_RASTERS))
        if path and _RASTERS[kind] == "elevation":
            self.elevation_chosen.emit([path])
        elif path:
            self.read(path, partial(_read_picture, path, _RASTERS[kind]), self._add_raster)

    def _add_raster(self, found: tuple[RasterSource, RasterArea | None]) -> None:
        """Add a raster source in one undo step; a sketch without a CRS gets the raster's place."""
        source, area = found
        sketch = self.document.sketch
        frame = sketch.frame if area is None or sketch.frame["crs"] else {**sketch.frame, **area.frame}
        self.change(f"Add {source.title}", rasters=(*sketch.rasters, source), frame=frame)

    def ask_add_drapes(self) -> None:
        """Ask for vector and raster files and drape them on the terrain."""
        if paths := self.ask_files("Add draped layers", _DRAPE_FILTER):
            self.add_drapes(paths)

    def add_drapes(self, paths: list[Path]) -> None:
        """Drape files on the terrain in one undo step."""
        first = len(self.document.sketch.drapes)

        def read() -> object:
            return [new_drape(path, number) for number, path in enumerate(paths, start=first)]

        self.read(paths[0], read, self.drapes_read.emit)

    def save_drape(self, number: int, ask: bool) -> None:
        """Save a draped layer with its edits in its file, or in another one."""
        from sketchterrain.drape.saving import DRIVERS, save_layer  # GDAL

        document, drapes = self.document, self.document.drapes.current
        if drapes is None or drapes.layers != document.sketch.drapes:
            self._report_save_error("the layer is not read yet")
            return
        path = Path(document.sketch.drapes[number].path)
        if ask or path.suffix.lower() not in DRIVERS:
            start = str(path.with_suffix(".gpkg"))
            name, _ = QFileDialog.getSaveFileName(self.window, "Save the layer", start, _SAVED_FILTER)
            path = Path(name)
            if not name:
                return
        try:
            saved = save_layer(drapes, number, path)
        except (SketchterrainError, OSError) as error:
            self._report_save_error(str(error))
            return
        self.banner.withdraw("file")
        document.do(f"Save {saved.title}", with_layer(document.sketch, number, saved))

    def open_dropped(self, paths: Iterable[Path], layer: str) -> None:
        """Open a dropped sketch, import dropped images of layers, or drape other files on the terrain."""
        files = list(paths)
        if files and all(path.suffix.lower() == ".png" and path.is_file() for path in files):
            self.import_layers(files, layer)
        elif files and all(f"*{path.suffix.lower()}" in DRAPED.split() and path.is_file() for path in files):
            self.add_drapes(files)
        elif files:
            self.open(files[0])

    def _show_reading(self, is_busy: bool) -> None:
        if is_busy:
            self._message_timer.start()
        else:
            self._message_timer.stop()
            self.banner.withdraw("reading")

    def _show_reading_message(self) -> None:
        what = "images" if self._requested is None else self._requested.name
        cancel = (("Cancel", self.reading.cancel),)
        self.banner.show_message(Message("info", f"Reading {what} …", "reading", cancel))

    def _show_sketch(self, path: Path | None, read: tuple[Hashes | None, Sketch]) -> None:
        files, sketch = read
        self.document.open(sketch, path, files)
        if path is not None:
            self._remember(path)
        self._show_notes(sketch.notes)

    def _show_notes(self, notes: Iterable[str]) -> None:
        if line := "; ".join(notes):
            self.banner.show_message(Message("warning", line, "file"))

    def _import(self, read: dict[str, tuple[LabelImage, list[str]]]) -> None:
        new = {name: image for name, (image, _) in read.items()}
        sketch = self.document.sketch
        titles = " and ".join(LAYERS[name].title.lower() for name in new)
        self.change(f"Import {titles}", layers={**sketch.layers, **new})
        self._show_notes(f"{name}: {note}" for name, (_, notes) in read.items() for note in notes)

    def change(self, title: str, **changes: object) -> None:
        """Change the sketch in one undo step, unless one that was opened meanwhile does not take it."""
        with reported(self._report_read_error):
            self.document.do(title, self.document.sketch.replace(**changes))

    def _remember(self, path: Path) -> None:
        self.banner.withdraw("file")
        self.preferences.last_folder = path.absolute().parent
        self.recent.add(path.absolute())

    def _report_read_error(self, line: str) -> None:
        self.banner.show_message(Message("error", line, "file"))
        if self._requested in self.recent.paths and not self._requested.exists():
            self.recent.forget(self._requested)
        self._requested = None

    def _report_save_error(self, line: str) -> None:
        buttons = (("Save as…", self.save_as),)
        self.banner.show_message(Message("error", f"Not saved: {line}", "file", buttons))

    def _default_name(self) -> str:
        name = re.sub(r"[^\w .-]+", "", self.document.sketch.name).strip(" .")
        return f"{name or 'sketch'}{_SUFFIX}"


def _load(path: Path) -> tuple[Hashes, Sketch]:
    if not path.exists():
        raise InputError(f"{path.name} no longer exists: {path.parent}")
    return file_hashes(path), load_sketch(path)  # in this order, so that a change is noticed


def _read_picture(path: Path, role: str) -> tuple[RasterSource, RasterArea | None]:
    from sketchterrain.importing.elevation import raster_area  # GDAL

    source = raster_source(path, role)
    return source, raster_area(source)


def _layer_image(path: Path, layer: str, shape: tuple[int, int]) -> tuple[LabelImage, list[str]]:
    with prefix_errors(path.name):
        image, notes = decode_layer(path.read_bytes(), layer)
    if image.shape != shape:
        (rows, columns), (height, width) = image.shape, shape
        raise InputError(f"{path.name} is {columns}×{rows} px: expected {width}×{height} px as the sketch")
    return image, notes


_TRACE_FILTER = (
    f"Maps, layers, vectors (*.png *.jpg *.jpeg *.tif *.tiff *.webp *.ora {_VECTORS});;All files (*)"
)
_WORLD_FILES = ("zarr.json", "ledger.jsonl")  # which stand for their folder
_WORLD_FILTER = f"Worlds ({' '.join(_WORLD_FILES)} *.tif *.tiff);;All files (*)"


class OpenDialogs(QObject):
    """Opens the dialogs of a window; those with much to import are imported on first use."""

    def __init__(self, files: Files, actions: Actions, link: EngineLink) -> None:
        super().__init__(files.window)
        self._files, self._actions, self._link = files, actions, link
        self._picture_file = PictureFile(files.banner, self)
        self.beside: dict[str, QDialog] = {}  # export and world dialogs, which are not modal
        self.worlds: list[WorldWindow] = []
        actions.bind(
            {
                "new": self.new,
                "presets": self.presets,
                "open-world": self.open_world,
                "trace": self.trace,
                "export": self.export,
                "write-world": self.write_world,
                "save-picture": self.save_picture,
                "preferences": self.preferences,
                "find": self.find,
                **{name: partial(self._show_help, name) for name in ("first-steps", "keys", "about")},
            }
        )
        link.picture_written.connect(lambda written: self._picture_file.report(Path(written.path)))

    def new(self) -> None:
        dialog = NewSketchDialog(self._files.window)
        if run_dialog(dialog):
            self._files.start_sketch(dialog.sketch())

    def presets(self) -> None:
        dialog = PresetsDialog(self._files.window)
        if run_dialog(dialog):
            self._files.open_preset(dialog.name)

    def open_world(self) -> None:
        """Ask for a stored world and show it in a window of its own."""
        path, _ = self._files.ask_file("Open a world", _WORLD_FILTER)
        if path:
            self.show_world(path.parent if path.name in _WORLD_FILES else path)

    def show_world(self, path: Path) -> None:
        """Show a stored world; its window reports errors."""
        self._files.preferences.last_folder = path.absolute().parent
        world = WorldWindow(path.absolute(), device=self._files.preferences.device)
        self.worlds.append(world)
        world.closed.connect(partial(self._delete_world, world))
        world.show()

    def _delete_world(self, world: WorldWindow) -> None:
        self.worlds.remove(world)
        world.deleteLater()

    def trace(self) -> None:
        path, _ = self._files.ask_file("New from a picture", _TRACE_FILTER)
        if path:
            self.trace_file(path)

    def trace_file(self, path: Path) -> None:
        """Ask what a picture's colours become and open the traced sketch."""
        from sketchterrain.ui.dialogs.trace import TraceDialog

        dialog = TraceDialog(path, self._files.window)
        if run_dialog(dialog):
            self._files.preferences.last_folder = path.absolute().parent
            self._files.start_sketch(dialog.sketch(), modified=True)

    def export(self) -> None:
        from sketchterrain.ui.dialogs.export import ExportDialog

        self._show_beside("export", ExportDialog)

    def write_world(self) -> None:
        from sketchterrain.ui.dialogs.world import WorldDialog

        self._show_beside("world", partial(WorldDialog, view=self.show_world))

    def _show_beside(self, name: str, create: Callable[..., QDialog]) -> None:
        dialog = self.beside.get(name)
        if dialog is None:
            dialog = self.beside[name] = create(
                self._files.document.sketch, self._files.preferences, self._files.window
            )
            dialog.finished.connect(partial(self._delete_dialog, name))
        dialog.show()
        dialog.raise_()
        dialog.activateWindow()

    def _delete_dialog(self, name: str, _: int = 0) -> None:
        self.beside.pop(name).deleteLater()

    def close_all(self) -> None:
        """Close dialogs and worlds beside the window; a running export is cancelled."""
        for dialog in tuple(self.beside.values()):
            dialog.close()
        for world in tuple(self.worlds):
            world.close()

    def save_picture(self) -> None:
        """Save the 3-D view's picture, as shown or rendered in another size."""
        picture = self._link.picture
        size = (0, 0) if picture is None else (picture.width(), picture.height())
        name = self._files.document.sketch.name or "terrain"
        dialog = PictureDialog(size, self._files.preferences.last_folder, name, self._files.window)
        if not run_dialog(dialog) or dialog.path is None:
            return
        if dialog.render_size is not None:
            self._files.banner.show_message(Message("info", "Drawing the picture …", "picture"))
            self._link.send(RenderPicture(str(dialog.path), *dialog.render_size))
        elif picture is not None:
            self._picture_file.write(picture, dialog.path)

    def preferences(self) -> None:
        run_dialog(help_dialogs.PreferencesDialog(self._files.preferences, self._files.window))

    def find(self) -> None:
        dialog = help_dialogs.FindDialog(self._actions, self._files.window)
        if run_dialog(dialog) and dialog.selected is not None:
            dialog.selected.trigger()

    def _show_help(self, name: str) -> None:
        dialogs: dict[str, Callable[[QWidget], QDialog]] = {
            "first-steps": help_dialogs.FirstStepsDialog,
            "keys": help_dialogs.KeysDialog,
            "about": partial(help_dialogs.AboutDialog, self._link.facts),
        }
        run_dialog(dialogs[name](self._files.window))
