"""Actions that open dialogs, and what their results do."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PyQt6.QtCore import QObject, QUrl
from PyQt6.QtGui import QDesktopServices, QImage
from PyQt6.QtWidgets import QDialog, QFileDialog, QWidget

from sketchterrain.errors import SketchterrainError
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.banner import Banner, Message
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import RenderPicture
from sketchterrain.ui.files import Files
from sketchterrain.ui.models.background import BackgroundQueue
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.preferences import Preferences

if TYPE_CHECKING:
    from sketchterrain.ui.world_window import WorldWindow


_TRACE_FILTER = (
    "Maps, layers, vectors (*.png *.jpg *.jpeg *.tif *.tiff *.webp *.ora *.geojson *.json *.gpkg"
    " *.fgb *.shp *.pbf)"
    ";;All files (*)"
)
_WORLD_FILES = ("zarr.json", "ledger.jsonl")  # which stand for their folder
_WORLD_FILTER = f"Worlds ({' '.join(_WORLD_FILES)} *.tif *.tiff);;All files (*)"


class PictureFile(QObject):
    """Writes pictures as PNG in the background and reports each in a banner."""

    def __init__(self, banner: Banner, parent: QObject) -> None:
        super().__init__(parent)
        self._banner, self._background = banner, BackgroundQueue(self)

    def write(self, picture: QImage, path: Path) -> None:
        self._background.do("picture", partial(_write_png, picture, path), partial(self.report, path))

    def report(self, path: Path, error: str = "") -> None:
        """Report a written picture, or an error."""
        if error:
            self._banner.show_message(Message("error", error, "picture"))
        else:
            folder = QUrl.fromLocalFile(str(path.parent))
            button = ("Open folder", partial(QDesktopServices.openUrl, folder))
            self._banner.show_message(Message("good", f"The picture is saved: {path}", "picture", (button,)))


def _write_png(picture: QImage, path: Path) -> None:
    if not picture.save(str(path), "PNG"):
        raise SketchterrainError(f"{path}: cannot be written")


class OpenDialogs(QObject):
    """Opens the dialogs of a window; each is imported on first use, so that the window opens sooner."""

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
        self._window, self._actions, self._banner = window, actions, banner
        self._document, self._link, self._files = document, link, files
        self._preferences = preferences
        self._picture_file = PictureFile(banner, self)
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
        from sketchterrain.ui.dialogs.start import NewSketchDialog

        dialog = NewSketchDialog(self._window)
        if _run(dialog):
            self._files.start_sketch(dialog.sketch())

    def presets(self) -> None:
        from sketchterrain.ui.dialogs.start import PresetsDialog

        dialog = PresetsDialog(self._window)
        if _run(dialog):
            self._files.open_preset(dialog.name)

    def open_world(self) -> None:
        """Ask for a stored world and show it in a window of its own."""
        start = str(self._preferences.last_folder)
        name, _ = QFileDialog.getOpenFileName(self._window, "Open a world", start, _WORLD_FILTER)
        if name:
            path = Path(name)
            self.show_world(path.parent if path.name in _WORLD_FILES else path)

    def show_world(self, path: Path) -> None:
        """Show a stored world; its window reports errors."""
        from sketchterrain.ui.world_window import WorldWindow

        self._preferences.last_folder = path.absolute().parent
        world = WorldWindow(path.absolute(), device=self._preferences.device)
        self.worlds.append(world)
        world.closed.connect(partial(self._delete_world, world))
        world.show()

    def _delete_world(self, world: WorldWindow) -> None:
        self.worlds.remove(world)
        world.deleteLater()

    def trace(self) -> None:
        """Ask for a picture and trace a new sketch from it."""
        start = str(self._preferences.last_folder)
        name, _ = QFileDialog.getOpenFileName(self._window, "New from a picture", start, _TRACE_FILTER)
        if name:
            self.trace_file(Path(name))

    def trace_file(self, path: Path) -> None:
        """Ask what a picture's colours become and open the traced sketch."""
        from sketchterrain.ui.dialogs.trace import TraceDialog

        dialog = TraceDialog(path, self._window)
        if _run(dialog):
            self._preferences.last_folder = path.absolute().parent
            self._files.start_sketch(dialog.sketch(), modified=True)

    def export(self) -> None:
        """Show the export dialog beside the window."""
        from sketchterrain.ui.dialogs.export import ExportDialog

        self._show_beside("export", ExportDialog)

    def write_world(self) -> None:
        """Show the world dialog beside the window."""
        from sketchterrain.ui.dialogs.world import WorldDialog

        self._show_beside("world", partial(WorldDialog, view=self.show_world))

    def _show_beside(self, name: str, create: Callable[..., QDialog]) -> None:
        dialog = self.beside.get(name)
        if dialog is None:
            dialog = self.beside[name] = create(self._document.sketch, self._preferences, self._window)
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
        from sketchterrain.ui.dialogs.start import PictureDialog

        picture = self._link.picture
        size = (0, 0) if picture is None else (picture.width(), picture.height())
        name = self._document.sketch.name or "terrain"
        dialog = PictureDialog(size, self._preferences.last_folder, name, self._window)
        if not _run(dialog) or dialog.path is None:
            return
        if dialog.render_size is not None:
            self._banner.show_message(Message("info", "Drawing the picture …", "picture"))
            self._link.send(RenderPicture(str(dialog.path), *dialog.render_size))
        elif picture is not None:
            self._picture_file.write(picture, dialog.path)

    def preferences(self) -> None:
        from sketchterrain.ui.dialogs.preferences import PreferencesDialog

        _run(PreferencesDialog(self._preferences, self._window))

    def find(self) -> None:
        from sketchterrain.ui.dialogs.help import FindDialog

        dialog = FindDialog(self._actions, self._window)
        if _run(dialog) and dialog.selected is not None:
            dialog.selected.trigger()

    def _show_help(self, name: str) -> None:
        from sketchterrain.ui.dialogs.help import AboutDialog, FirstStepsDialog, KeysDialog

        dialogs: dict[str, Callable[[QWidget], QDialog]] = {
            "first-steps": FirstStepsDialog,
            "keys": KeysDialog,
            "about": partial(AboutDialog, self._link.facts),
        }
        _run(dialogs[name](self._window))


def _run(dialog: QDialog) -> bool:
    accepted = bool(dialog.exec())
    dialog.deleteLater()
    return accepted
