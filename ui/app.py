"""The desktop program from its start to its end."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sketchterrain.resources import preset_names
from sketchterrain.sketch import load_sketch
from sketchterrain.ui.screen import check_screen

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QApplication

    from sketchterrain.sketch import Sketch
    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.models.autosave import Autosave, Recovery
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.preferences import Preferences
    from sketchterrain.ui.window import MainWindow

FIRST = "valley_river"
"""The preset that a new user sees first."""


def run(name: str | None = None) -> int:
    """Show the window until it is closed."""
    check_screen()
    sketch, path = load_sketch(name or FIRST), _path_of(name)
    from sketchterrain.ui.application import named_application

    app = named_application()  # kept until all of the window's models are gone
    return _show(app, sketch, path)


def run_world(path: Path, *, device: str | None = None) -> int:
    """Show a stored world until its window is closed; errors are those of `run`."""
    check_screen()
    from sketchterrain.world.opening import open_world

    open_world(path)
    from sketchterrain.ui.application import Garbage, delete_window, named_application
    from sketchterrain.ui.look.theme import apply_theme
    from sketchterrain.ui.models.preferences import Preferences, config_folder
    from sketchterrain.ui.worlds.window import WorldWindow

    app = named_application()
    preferences = Preferences(config_folder() / "desktop.ini")
    apply_theme(app, preferences.theme)
    window = WorldWindow(path.absolute(), device=device or preferences.device)
    window.show()
    garbage = Garbage()
    code = app.exec()
    window.link.stop()
    delete_window(window)
    garbage.end()
    return code


def _show(app: QApplication, sketch: Sketch, path: Path | None) -> int:
    from PyQt6.QtCore import QTimer

    from sketchterrain.ui.application import delete_window
    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.look.theme import apply_theme
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.preferences import Preferences, config_folder, state_folder

    settings = config_folder() / "desktop.ini"
    is_new = not settings.exists()
    preferences = Preferences(settings)
    document = Document(sketch)
    document.open(sketch, path)
    link = EngineLink(document)
    link.device = preferences.device
    link.start()  # its processes load their libraries while this one builds the window
    apply_theme(app, preferences.theme)
    from sketchterrain.ui.application import Garbage
    from sketchterrain.ui.models.autosave import Autosave

    window = new_window(document, link, preferences, state_folder())
    if path is not None:
        window.files.recent.add(path.absolute())
    window.surprises.catch_all()
    autosave = Autosave(document, state_folder() / "recovery")
    autosave.failed.connect(window.warn)
    preferences.theme_changed.connect(partial(apply_theme, app))

    def change_device() -> None:
        link.stop()
        link.device = preferences.device
        link.start()

    preferences.device_changed.connect(change_device)
    window.show()
    garbage = Garbage()
    QTimer.singleShot(0, lambda: _welcome(window, document, autosave, is_new=is_new))
    code = app.exec()
    window.hide()
    link.stop()
    autosave.close()
    window.surprises.let_go()
    delete_window(window)
    garbage.end()
    return code


def new_window(document: Document, link: EngineLink, preferences: Preferences, state: Path) -> MainWindow:
    """Return a window, which remembers recent files and bookmarks in a folder."""
    from sketchterrain.ui.models.background import Saving
    from sketchterrain.ui.models.bookmarks import Bookmarks
    from sketchterrain.ui.models.preferences import RecentFiles
    from sketchterrain.ui.models.workspace import Workspace
    from sketchterrain.ui.window import MainWindow

    recent, bookmarks = RecentFiles(state / "recent"), Bookmarks(document, state / "bookmarks")
    window = MainWindow(
        document,
        Workspace(),
        link,
        preferences=preferences,
        recent=recent,
        saving=Saving(document),
        bookmarks=bookmarks,
    )
    bookmarks.failed.connect(window.warn)
    return window


def _welcome(window: MainWindow, document: Document, autosave: Autosave, *, is_new: bool) -> None:
    """Offer what a crash left behind; tell a new user where to begin."""
    from sketchterrain.ui.banner import Message

    found = autosave.recoverable()
    if found:
        _offer(found, window, document, autosave)
    elif is_new:
        steps = window.actions_by_name["first-steps"].trigger
        message = Message(
            "info", "New here? Six steps lead to a terrain.", "welcome", (("First steps", steps),)
        )
        window.banner.tell(message)


def _offer(found: list[Recovery], window: MainWindow, document: Document, autosave: Autosave) -> None:
    from sketchterrain.ui.dialogs.start import RecoveryDialog

    dialog = RecoveryDialog(found, window)
    if dialog.exec():
        recovery = dialog.chosen
        if not dialog.discarded:
            sketch = load_sketch(recovery.path)
            document.open(sketch, recovery.original, modified=True)
        autosave.discard(recovery)
    dialog.deleteLater()


def _path_of(name: str | None) -> Path | None:
    """Return where a sketch is saved; None for a preset, which is no file of the person's."""
    if name is None:
        return None
    path = Path(name)
    is_preset = name in preset_names() and not path.is_file() and not (path / "sketch.toml").is_file()
    return None if is_preset else path
