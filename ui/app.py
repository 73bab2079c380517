"""The desktop program: start-up, crash recovery and shutdown."""

from __future__ import annotations

import ctypes
import os
import re
from collections.abc import Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import file_hashes, load_sketch
from sketchterrain.errors import SketchterrainError
from sketchterrain.io.resources import preset_names

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QApplication

    from sketchterrain.document.drapes import DrapedLayer
    from sketchterrain.ui.models.background import Autosave
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.window import MainWindow

_DEFAULT_PRESET = "valley_river"


def run(name: str | None = None) -> int:
    """Show the main window until it is closed; return the exit code."""
    check_screen()
    path = _file_of(name)
    files, sketch = {} if path is None else file_hashes(path), load_sketch(name or _DEFAULT_PRESET)
    from sketchterrain.ui.application import named_application

    app = named_application()  # referenced until all models of the window are gone
    return _run_editor(app, sketch, path, files)


def run_world(path: Path, drapes: Sequence[DrapedLayer] = (), *, device: str | None = None) -> int:
    """Show a stored world, with draped layers, until its window is closed; return the exit code."""
    check_screen()
    from sketchterrain.world.stored_world import at_corner, draped_sketch, open_world

    world = open_world(path)
    sketch = draped_sketch(world, drapes)
    from sketchterrain.ui.application import named_application, show_until_closed
    from sketchterrain.ui.look.theme import apply_theme
    from sketchterrain.ui.models.workspace import Preferences, config_folder
    from sketchterrain.ui.world_window import WorldWindow

    app = named_application()
    preferences = Preferences(config_folder() / "desktop.ini")
    apply_theme(app, preferences.theme)
    draped = None if sketch is None else at_corner(sketch, (world.west, world.north))
    window = WorldWindow(path.absolute(), draped, device=device or preferences.device)
    return show_until_closed(app, window, window.link.stop)


def _run_editor(app: QApplication, sketch: Sketch, path: Path | None, files: Mapping[str, str]) -> int:
    from PyQt6.QtCore import QTimer

    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.look.theme import apply_theme
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.workspace import Preferences, Workspace, config_folder, state_folder

    settings = config_folder() / "desktop.ini"
    is_new = not settings.exists()
    preferences = Preferences(settings)
    document = Document(sketch)
    document.open(sketch, path, files)
    link = EngineLink(document)
    link.device = preferences.device
    link.start()  # its processes load their libraries while this one builds the window
    apply_theme(app, preferences.theme)
    from sketchterrain.ui.application import show_until_closed
    from sketchterrain.ui.models.background import Autosave
    from sketchterrain.ui.window import MainWindow

    window = MainWindow(document, Workspace(), link, preferences, state_folder())
    if path is not None:
        window.files.recent.add(path.absolute())
    window.uncaught_exceptions.install()
    autosave = Autosave(document, state_folder() / "recovery")
    autosave.failed.connect(window.warn)
    preferences.theme_changed.connect(partial(apply_theme, app))

    def change_device() -> None:
        link.device = preferences.device
        link.start()

    preferences.device_changed.connect(change_device)
    QTimer.singleShot(0, lambda: _welcome(window, document, autosave, is_new=is_new))

    def stop() -> None:
        link.stop()
        autosave.close()
        window.uncaught_exceptions.uninstall()

    return show_until_closed(app, window, stop)


def _welcome(window: MainWindow, document: Document, autosave: Autosave, *, is_new: bool) -> None:
    """Offer to recover unsaved sketches; point a new user to the first steps."""
    from sketchterrain.ui.banner import Message

    recoveries = autosave.recoverable()
    if recoveries:
        from sketchterrain.ui.dialogs.start import RecoveryDialog

        dialog = RecoveryDialog(recoveries, window)
        if dialog.exec():
            recovery = dialog.selected
            if not dialog.discarded:
                document.open(load_sketch(recovery.path), recovery.original, recovery.files, modified=True)
            autosave.discard(recovery)
        dialog.deleteLater()
    elif is_new:
        button = ("First steps", window.actions_by_name["first-steps"].trigger)
        line = "New here? Six steps lead to a terrain."
        window.banner.show_message(Message("info", line, "welcome", (button,)))


def _file_of(name: str | None) -> Path | None:
    """Return the path of a sketch; None for a preset."""
    if name is None:
        return None
    path = Path(name).absolute()
    is_preset = name in preset_names() and not path.is_file() and not (path / "sketch.toml").is_file()
    return None if is_preset else path


_PACKAGES = {
    "libxkbcommon-x11": "libxkbcommon-x11-0",
    "libEGL": "libegl1",
    "libGL": "libgl1",
    "libdbus-1": "libdbus-1-3",
    "libfontconfig": "libfontconfig1",
    "libglib-2.0": "libglib2.0-0",
}
"""Packages of Debian and Ubuntu by library; those of other ``libxcb`` libraries are named after them."""


def check_screen(environment: Mapping[str, str] = os.environ) -> None:
    """Raise `SketchterrainError` unless Qt finds a display."""
    try:
        import PyQt6.QtWidgets  # noqa: F401
    except ModuleNotFoundError:
        raise SketchterrainError("the desktop program needs Qt: pip install PyQt6") from None
    except ImportError as error:  # its message names a missing library of the system
        raise SketchterrainError(_install_hint(str(error))) from None
    platform = environment.get("QT_QPA_PLATFORM", "").split(";")[0].split(":")[0]
    if platform and platform not in ("xcb", "wayland"):
        return  # such as offscreen
    display, wayland = environment.get("DISPLAY", ""), environment.get("WAYLAND_DISPLAY", "")
    if wayland and platform != "xcb" and _wayland_answers(environment, wayland):
        return
    if platform == "wayland":
        raise SketchterrainError("no display: expected WAYLAND_DISPLAY to name a running compositor")
    if not display:
        raise SketchterrainError(
            "no display: neither DISPLAY nor WAYLAND_DISPLAY is set; start this in a desktop session, or "
            "with `xvfb-run sketchterrain edit`"
        )
    _check_plugin()
    if not _x_answers(display):
        raise SketchterrainError(f"no display: the X server at DISPLAY={display} does not answer")


def _check_plugin() -> None:
    """Load the libraries that Qt's windows need on X; without them QApplication aborts the process."""
    spec = find_spec("PyQt6")
    if spec is None or spec.origin is None:
        return
    plugin = Path(spec.origin).parent / "Qt6/plugins/platforms/libqxcb.so"
    if not plugin.is_file():
        return  # a distribution's own Qt: its packages depend on them
    try:
        ctypes.CDLL(str(plugin))
    except OSError as error:
        raise SketchterrainError(_install_hint(str(error))) from None


def _install_hint(line: str) -> str:
    """Return an error message for a missing library, with the package to install."""
    match = re.search(r"(lib[\w.+-]+?)\.so", line)
    if match is None:
        return f"Qt cannot be loaded: {line}"
    usual = f"{match[1]}0" if match[1].startswith("libxcb-") else ""
    package = _PACKAGES.get(match[1], usual)
    advice = f"; on Debian and Ubuntu: apt install {package}" if package else ""
    return f"Qt needs {match[1]}, which is not installed{advice}"


def _x_answers(display: str) -> bool:
    try:
        xcb = ctypes.CDLL("libxcb.so.1")
    except OSError:
        return True  # the plugin could be loaded, so Qt brings its own
    xcb.xcb_connect.restype = ctypes.c_void_p
    xcb.xcb_connect.argtypes = [ctypes.c_char_p, ctypes.c_void_p]
    xcb.xcb_connection_has_error.argtypes = [ctypes.c_void_p]
    xcb.xcb_disconnect.argtypes = [ctypes.c_void_p]
    connection = xcb.xcb_connect(display.encode(), None)
    answers = bool(xcb.xcb_connection_has_error(connection) == 0)
    xcb.xcb_disconnect(connection)
    return answers


def _wayland_answers(environment: Mapping[str, str], name: str) -> bool:
    folder = environment.get("XDG_RUNTIME_DIR", "")
    return (Path(name) if name.startswith("/") else Path(folder) / name).is_socket()
