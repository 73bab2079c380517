"""The Qt application object and its garbage collection."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import Final

from PyQt6.QtCore import QEvent, QObject, QTimer
from PyQt6.QtWidgets import QApplication, QWidget

_COLLECTION_INTERVAL: Final = 2000  # ms
_FULL_EVERY: Final = 30  # collections


def named_application() -> QApplication:
    """Return a new application with the names that desktops show."""
    app = QApplication(sys.argv[:1])
    app.setApplicationName("sketchterrain")
    app.setApplicationDisplayName("Sketchterrain")
    app.setDesktopFileName("sketchterrain")
    return app


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


def show_until_closed(app: QApplication, window: QWidget, stop: Callable[[], object]) -> int:
    """Run the event loop until a window is closed, stop its engine and delete it; return the exit code."""
    window.show()
    garbage_collection = GarbageCollection()
    code = app.exec()
    window.hide()
    stop()
    window.deleteLater()  # at once, so that views go before their models
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
    garbage_collection.stop()
    return code
