"""Qt's application, deletion of its window, and garbage collection on the window's thread."""

from __future__ import annotations

import gc
import sys
from typing import Final

from PyQt6.QtCore import QEvent, QObject, QTimer
from PyQt6.QtWidgets import QApplication, QWidget


def named_application() -> QApplication:
    """Return a new application that desktops know by its name."""
    app = QApplication(sys.argv[:1])
    app.setApplicationName("sketchterrain")
    app.setApplicationDisplayName("Sketchterrain")
    app.setDesktopFileName("sketchterrain")
    return app


def delete_window(window: QWidget) -> None:
    """Delete a window now, after the last event: views go before the models that they look at."""
    window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)


_OFTEN: Final = 2000
"""ms between two looks."""
_OLD_EVERY: Final = 30
"""Looks, after which what is old is searched, too."""


class Garbage(QObject):
    """Searches for garbage from time to time, for as long as it lives.

    What is there when it is made is left out of every search: of the whole program that takes a tenth of a
    second, and the window would stall.
    """

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._looks = 0
        gc.disable()
        gc.collect()
        gc.freeze()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)
        self._timer.start(_OFTEN)

    def end(self) -> None:
        """Leave it to Python again."""
        self._timer.stop()
        gc.unfreeze()
        gc.enable()

    def _look(self) -> None:
        self._looks += 1
        gc.collect(2 if self._looks % _OLD_EVERY == 0 else 1)
