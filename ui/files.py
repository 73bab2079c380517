"""New, open, save: what happens between the menu File, the document and the disk."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import cast

from PyQt6.QtCore import QObject, QTimer
from PyQt6.QtWidgets import QFileDialog, QMessageBox, QWidget

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.sketch import LAYERS, Sketch, load_sketch
from sketchterrain.sketch.document import LabelImage
from sketchterrain.sketch.layer_images import decode_layer
from sketchterrain.ui.banner import Banner, Message
from sketchterrain.ui.models.background import Reading, Saving
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.preferences import Preferences, RecentFiles

_PATIENCE = 400  # ms that a file may take until that is told
_ZIP, _SETTINGS = ".sketch", "sketch.toml"
_OPEN = f"Sketches (*{_ZIP} {_SETTINGS});;All files (*)"
_ONE_FILE, _FOLDER = f"Sketch in one file (*{_ZIP})", "Sketch as a folder of images (*)"


class Files(QObject):
    """Brings sketches from the disk into a document and back. Failures become messages."""

    def __init__(
        self,
        window: QWidget,
        *,
        document: Document,
        preferences: Preferences,
        recent: RecentFiles,
        saving: Saving,
        banner: Banner,
    ) -> None:
        super().__init__(window)
        self._window = window
        self._document = document
        self._preferences = preferences
        self.recent = recent
        self._saving = saving
        self._banner = banner
        self._asked: Path | None = None
        self.reading = Reading(self)
        self.reading.failed.connect(self._refuse)
        self._patience = QTimer(self)
        self._patience.setSingleShot(True)
        self._patience.setInterval(_PATIENCE)
        self._patience.timeout.connect(self._tell_reading)
        self.reading.busy_changed.connect(self._show_reading)
        saving.saved.connect(self._saved)
        saving.failed.connect(self._not_saved)

    def begin(self, sketch: Sketch, *, modified: bool = False) -> None:
        """Work on a sketch that is saved nowhere, if the one that is open may go."""
        if self.may_leave():
            self._document.open(sketch, modified=modified)

    def ask_open(self) -> None:
        """Ask for a file and open it."""
        start = str(self._preferences.last_folder)
        name, _ = QFileDialog.getOpenFileName(self._window, "Open a sketch", start, _OPEN)
        if name:
            path = Path(name)
            self.open(path.parent if path.name == _SETTINGS else path)

    def ask_open_folder(self) -> None:
        """Ask for a folder and open it."""
        start = str(self._preferences.last_folder)
        name = QFileDialog.getExistingDirectory(self._window, "Open a sketch's folder", start)
        if name:
            self.open(Path(name))

    def open(self, path: Path) -> None:
        """Open a sketch's folder or file, if the one that is open may go."""
        if self.may_leave():
            self._asked = path
            self.reading.read(partial(_sketch_at, path), partial(self._opened, path))

    def open_preset(self, name: str) -> None:
        """Begin with a preset, if the sketch that is open may go."""
        if self.may_leave():
            self._asked = Path(name)
            self.reading.read(partial(load_sketch, name), partial(self._opened, None))

    def save(self) -> None:
        """Save the sketch where it was saved, or ask where."""
        if self._document.path is None:
            self.save_as()
        else:
            self._saving.save(self._document.path)

    def save_as(self) -> bool:
        """Ask where to save the sketch, and begin to; False if nowhere."""
        path = self._document.path or self._preferences.last_folder / f"{_file_name(self._document)}{_ZIP}"
        kind = _FOLDER if self._document.path and path.suffix.lower() != _ZIP else _ONE_FILE
        name, chosen = QFileDialog.getSaveFileName(
            self._window, "Save the sketch", str(path), f"{_ONE_FILE};;{_FOLDER}", kind
        )
        if not name:
            return False
        path = Path(name)
        if chosen != _FOLDER and path.suffix.lower() != _ZIP and not path.is_dir():
            path = path.with_name(path.name + _ZIP)
        self._saving.save(path)
        return True

    def may_leave(self) -> bool:
        """Ask what to do with changes that are not saved; False if the sketch shall stay open."""
        draft = self._document.draft
        if draft is not None:
            draft.cancel()
        if not self._document.is_modified:
            return self._saving.wait() or not self._saving.is_busy
        button = QMessageBox.StandardButton
        box = QMessageBox(
            QMessageBox.Icon.NoIcon,
            "Sketchterrain",
            f"Save the changes to “{self._document.sketch.name}”?",
            button.Save | button.Discard | button.Cancel,
            self._window,
        )
        box.setInformativeText("They are lost if you do not.")
        box.setDefaultButton(button.Save)
        answer = box.exec()
        box.deleteLater()
        if answer == button.Save:
            if self._document.path is None:
                return self.save_as() and self._saving.wait()
            self._saving.save(self._document.path)
            return self._saving.wait()
        return answer == button.Discard

    def ask_import(self, layer: str) -> None:
        """Ask for an image and take it as the paint of the layer that its name says, else of `layer`."""
        start = str(self._preferences.last_folder)
        name, _ = QFileDialog.getOpenFileName(self._window, "Import a layer", start, "Layer images (*.png)")
        if name:
            self.import_layers([Path(name)], layer)

    def import_layers(self, paths: Iterable[Path], layer: str) -> None:
        """Take images as layers' paint, as one step."""
        places = {path.stem.lower() if path.stem.lower() in LAYERS else layer: path for path in paths}
        shape = next(iter(self._document.sketch.layers.values())).shape

        def work() -> object:
            return {name: _layer_image(path, (shape[0], shape[1])) for name, path in places.items()}

        self.reading.read(work, self._imported)

    def take(self, paths: Iterable[Path], layer: str) -> None:
        """Take what was dropped onto the window: a sketch, or images of layers."""
        files = list(paths)
        if files and all(path.suffix.lower() == ".png" and path.is_file() for path in files):
            self.import_layers(files, layer)
        elif files:
            path = files[0]
            self.open(path.parent if path.name == _SETTINGS else path)

    def _show_reading(self, reads: bool) -> None:
        if reads:
            self._patience.start()
        else:
            self._patience.stop()
            self._banner.withdraw("reading")

    def _tell_reading(self) -> None:
        what = "images" if self._asked is None else self._asked.name
        cancel = (("Cancel", self.reading.cancel),)
        self._banner.tell(Message("info", f"Reading {what} …", "reading", cancel))

    def _opened(self, path: Path | None, sketch: object) -> None:
        self._asked = None
        self._banner.withdraw("file")
        self._document.open(cast(Sketch, sketch), path)
        if path is not None:
            self._remember(path)

    def _imported(self, images: object) -> None:
        new = cast("dict[str, LabelImage]", images)
        sketch = self._document.sketch
        titles = " and ".join(LAYERS[name].title.lower() for name in new)
        try:
            changed = sketch.replace(layers={**sketch.layers, **new})
        except InputError as error:  # another sketch, of another size, was opened meanwhile
            self._refuse(str(error))
            return
        self._document.do(f"Import {titles}", changed)

    def _saved(self, path: Path) -> None:
        self._banner.withdraw("file")
        self._remember(path)

    def _remember(self, path: Path) -> None:
        whole = path.absolute()
        self._preferences.last_folder = whole.parent
        self.recent.add(whole)

    def _refuse(self, line: str) -> None:
        self._banner.tell(Message("error", line, "file"))
        if self._asked in self.recent.paths and not self._asked.exists():
            self.recent.forget(self._asked)
        self._asked = None

    def _not_saved(self, line: str) -> None:
        buttons = (("Save as…", self.save_as),)
        self._banner.tell(Message("error", f"Not saved: {line}", "file", buttons))


def _sketch_at(path: Path) -> Sketch:
    if not path.exists():
        raise InputError(f"{path.name} is not there any more: {path.parent}")
    return load_sketch(path)


def _file_name(document: Document) -> str:
    """Return the sketch's name as a file may be called."""
    name = re.sub(r"[^\w .-]+", "", document.sketch.name).strip(" .")
    return name or "sketch"


def _layer_image(path: Path, shape: tuple[int, int]) -> LabelImage:
    try:
        image = decode_layer(path.read_bytes())
    except SketchterrainError as error:
        raise InputError(f"{path.name}: {error}") from None
    if image.shape != shape:
        (rows, columns), (height, width) = image.shape, shape
        raise InputError(f"{path.name} is {columns}×{rows} px: expected {width}×{height} px as the sketch")
    return image
