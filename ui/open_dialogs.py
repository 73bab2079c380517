"""The actions that open a dialog, and what comes of each."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PyQt6.QtCore import QObject, QUrl
from PyQt6.QtGui import QDesktopServices
from PyQt6.QtWidgets import QFileDialog

from sketchterrain.errors import SketchterrainError
from sketchterrain.ui.banner import Message
from sketchterrain.ui.engine.protocol import RenderPicture
from sketchterrain.ui.models.background import Background

if TYPE_CHECKING:
    from PyQt6.QtGui import QImage
    from PyQt6.QtWidgets import QDialog, QWidget

    from sketchterrain.ui.actions import Actions
    from sketchterrain.ui.banner import Banner
    from sketchterrain.ui.dialogs.export import ExportDialog
    from sketchterrain.ui.dialogs.world import WorldDialog
    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.files import Files
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.preferences import Preferences
    from sketchterrain.ui.worlds.window import WorldWindow


_TRACED = (
    "Maps, layers, vectors (*.png *.jpg *.jpeg *.tif *.tiff *.webp *.ora *.geojson *.json *.gpkg"
    " *.fgb *.shp *.pbf)"
    ";;All files (*)"
)

_WORLD_FILES = ("zarr.json", "ledger.jsonl")
"""What a world that is a folder is chosen by."""
_WORLDS = f"Worlds ({' '.join(_WORLD_FILES)} *.tif *.tiff);;All files (*)"


class OpenDialogs(QObject):
    """Opens dialogs over a window. Each is loaded when it is first asked for: the window is there sooner."""

    def __init__(
        self,
        window: QWidget,
        actions: Actions,
        *,
        document: Document,
        link: EngineLink,
        preferences: Preferences,
        files: Files,
        banner: Banner,
    ) -> None:
        super().__init__(window)
        self._window = window
        self._actions = actions
        self._document = document
        self._link = link
        self._preferences = preferences
        self._files = files
        self._banner = banner
        self._writing = Background(self)
        self.exporting: ExportDialog | None = None
        self.writing_world: WorldDialog | None = None
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
                "first-steps": self.first_steps,
                "keys": self.keys,
                "find": self.find,
                "about": self.about,
            }
        )
        link.picture_written.connect(self._tell_picture)

    def new(self) -> None:
        """Begin another sketch."""
        from sketchterrain.ui.dialogs.new_sketch import NewSketchDialog

        dialog = NewSketchDialog(self._window)
        if self._run(dialog):
            self._files.begin(dialog.sketch())

    def presets(self) -> None:
        """Begin with a preset."""
        from sketchterrain.ui.dialogs.start import PresetsDialog

        dialog = PresetsDialog(self._window)
        if self._run(dialog):
            self._files.open_preset(dialog.name)

    def open_world(self) -> None:
        """Ask for a written world and show it in a window of its own."""
        start = str(self._preferences.last_folder)
        name, _ = QFileDialog.getOpenFileName(self._window, "Open a world", start, _WORLDS)
        if name:
            path = Path(name)
            self.show_world(path.parent if path.name in _WORLD_FILES else path)

    def show_world(self, path: Path) -> None:
        """Show a world; what is wrong with it is told in its window."""
        from sketchterrain.ui.worlds.window import WorldWindow

        self._preferences.last_folder = path.absolute().parent
        world = WorldWindow(path.absolute(), device=self._preferences.device)
        self.worlds.append(world)
        world.closed.connect(partial(self._end_world, world))
        world.show()

    def _end_world(self, world: WorldWindow) -> None:
        self.worlds.remove(world)
        world.deleteLater()

    def trace(self) -> None:
        """Begin with what is in a picture."""
        start = str(self._preferences.last_folder)
        name, _ = QFileDialog.getOpenFileName(self._window, "New from a picture", start, _TRACED)
        if name:
            self.trace_file(Path(name))

    def trace_file(self, path: Path) -> None:
        """Ask what a picture's colours become, and begin with that."""
        from sketchterrain.ui.dialogs.trace import TraceDialog

        dialog = TraceDialog(path, self._window)
        if self._run(dialog):
            self._preferences.last_folder = path.absolute().parent
            self._files.begin(dialog.sketch(), modified=True)

    def export(self) -> None:
        """Export the terrain."""
        from sketchterrain.ui.dialogs.export import ExportDialog

        if self.exporting is None:
            self.exporting = ExportDialog(self._document.sketch, self._preferences, parent=self._window)
            self.exporting.finished.connect(self._end_export)
        _show(self.exporting)

    def write_world(self) -> None:
        """Write a world of any size."""
        from sketchterrain.ui.dialogs.world import WorldDialog

        if self.writing_world is None:
            self.writing_world = WorldDialog(self._document.sketch, self._preferences, parent=self._window)
            self.writing_world.viewed.connect(self.show_world)
            self.writing_world.finished.connect(self._end_writing_world)
        _show(self.writing_world)

    def end(self) -> None:
        """Close what stands open beside the window; an export is cancelled."""
        for dialog in (self.exporting, self.writing_world):
            if dialog is not None:
                dialog.close()
        for world in tuple(self.worlds):
            world.close()

    def _end_export(self) -> None:
        dialog, self.exporting = self.exporting, None
        if dialog is not None:
            dialog.deleteLater()

    def _end_writing_world(self) -> None:
        dialog, self.writing_world = self.writing_world, None
        if dialog is not None:
            dialog.deleteLater()

    def save_picture(self) -> None:
        """Save what the 3-D view shows."""
        from sketchterrain.ui.dialogs.new_sketch import PictureDialog

        shown = self._link.picture
        size = (0, 0) if shown is None else (shown.width(), shown.height())
        folder = self._preferences.last_folder
        dialog = PictureDialog(size, folder, self._document.sketch.name or "terrain", self._window)
        if not self._run(dialog) or dialog.path is None:
            return
        wanted = dialog.size_wanted
        if wanted is not None:
            self._banner.tell(Message("info", "Drawing the picture …", "picture"))
            self._link.tell(RenderPicture(str(dialog.path), *wanted))
        elif shown is not None:
            path = dialog.path
            self._writing.do("picture", partial(_write, shown, path), partial(self._written, path))

    def preferences(self) -> None:
        """Choose theme and device."""
        from sketchterrain.ui.dialogs.preferences import PreferencesDialog

        self._run(PreferencesDialog(self._preferences, self._window))

    def first_steps(self) -> None:
        """Show how to begin."""
        from sketchterrain.ui.dialogs.help import FirstStepsDialog

        self._run(FirstStepsDialog(self._window))

    def keys(self) -> None:
        """Show all keys."""
        from sketchterrain.ui.dialogs.help import KeysDialog

        self._run(KeysDialog(self._window))

    def find(self) -> None:
        """Find a command and do it."""
        from sketchterrain.ui.dialogs.help import FindDialog

        dialog = FindDialog(self._actions, self._window)
        if self._run(dialog) and dialog.chosen is not None:
            dialog.chosen.trigger()

    def about(self) -> None:
        """Show what this is."""
        from sketchterrain.ui.dialogs.help import AboutDialog

        self._run(AboutDialog(self._link.facts, self._window))

    @staticmethod
    def _run(dialog: QDialog) -> bool:
        accepted = bool(dialog.exec())
        dialog.deleteLater()
        return accepted

    def _written(self, path: Path, problem: str) -> None:
        if problem:
            self._banner.tell(Message("error", problem, "picture"))
        else:
            self._tell_picture(str(path))

    def _tell_picture(self, path: str) -> None:
        folder = QUrl.fromLocalFile(str(Path(path).parent))
        button = ("Open folder", partial(QDesktopServices.openUrl, folder))
        self._banner.tell(Message("good", f"The picture is saved: {path}", "picture", (button,)))


def _show(dialog: QDialog) -> None:
    """Show a dialog beside the window: one goes on painting."""
    dialog.show()
    dialog.raise_()
    dialog.activateWindow()


def _write(picture: QImage, path: Path) -> None:
    if not picture.save(str(path), "PNG"):
        raise SketchterrainError(f"{path}: cannot be written")
