"""Qt's application under the program's name, and how its window goes before it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from PyQt6.QtCore import QEvent
from PyQt6.QtWidgets import QApplication

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QWidget

__all__ = ["delete_window", "named_application"]


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
