"""The Qt application: settings before it starts, and the screen."""

from __future__ import annotations

import ctypes
import gc
import os
import re
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QEvent, QObject, QTimer
from PyQt6.QtWidgets import QApplication, QWidget

from sketchterrain.errors import SketchterrainError

if TYPE_CHECKING:
    from collections.abc import Mapping


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


_COLLECTION_INTERVAL: Final = 2000  # ms
_FULL_EVERY: Final = 30  # collections


def named_application() -> QApplication:
    """Return a new application with the names that desktops show."""
    app = QApplication(sys.argv[:1])
    app.setApplicationName("sketchterrain")
    app.setApplicationDisplayName("Sketchterrain")
    app.setDesktopFileName("sketchterrain")
    return app


def delete_window(window: QWidget) -> None:
    """Delete a window at once, so that its views go before their models."""
    window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)


def single_shot(parent: QObject, milliseconds: int, on_timeout: Callable[[], object]) -> QTimer:
    """Return a single-shot timer that is not yet started."""
    timer = QTimer(parent)
    timer.setSingleShot(True)
    timer.setInterval(milliseconds)
    timer.timeout.connect(on_timeout)
    return timer


class GarbageCollection(QObject):
    """Periodic garbage collection on this thread, in place of Python's automatic one.

    Existing objects are frozen: collecting the whole program takes 0.1 s and would stall the window.
    """

    def __init__(self) -> None:
        super().__init__()
        self._count = 0
        gc.disable()
        gc.collect()
        gc.freeze()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._collect)
        self._timer.start(_COLLECTION_INTERVAL)

    def stop(self) -> None:
        """Return to automatic garbage collection."""
        self._timer.stop()
        gc.unfreeze()
        gc.enable()

    def _collect(self) -> None:
        self._count += 1
        gc.collect(2 if self._count % _FULL_EVERY == 0 else 1)
