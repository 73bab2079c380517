"""Saving a document beside the window; the newest state wins."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.sketch import Sketch, save_sketch
from sketchterrain.ui.models.background import Background
from sketchterrain.ui.models.document import Document


class Saving(QObject):
    """Writes a document's sketch, whole or not at all, while a person works on."""

    saved = pyqtSignal(object)
    """The `Path` where the sketch is saved now."""
    failed = pyqtSignal(str)
    """Why it could not be saved, one line; what was there before is there still."""
    busy_changed = pyqtSignal(bool)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._background = Background(self)
        self._background.busy_changed.connect(self.busy_changed)
        self._worked = True

    @property
    def is_busy(self) -> bool:
        """Whether something is being saved."""
        return self._background.is_busy

    def save(self, path: Path) -> None:
        """Save the sketch as it is now, without a stroke that is still being drawn."""
        sketch = self._document.sketch
        self._background.do(
            path.absolute(), partial(save_sketch, sketch, path), partial(self._finish, sketch, path)
        )

    def wait(self) -> bool:
        """Block until all is saved; return whether the last save worked."""
        self._background.wait()
        return self._worked

    def _finish(self, sketch: Sketch, path: Path, line: str) -> None:
        self._worked = not line
        if line:
            self.failed.emit(line)
        else:
            self._document.saved(sketch, path)
            self.saved.emit(path)
