"""Files read beside the window: it goes on working while a large sketch is decoded."""

from __future__ import annotations

from collections.abc import Callable
from threading import Thread

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.errors import SketchterrainError


class Reading(QObject):
    """Reads one thing at a time; the newest one asked for counts, answers to earlier ones are dropped."""

    failed = pyqtSignal(str)
    """Why it could not be read, one line."""
    busy_changed = pyqtSignal(bool)
    _finished = pyqtSignal(int, object, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._newest = 0
        self._then: Callable[[object], None] | None = None
        self._finished.connect(self._finish)

    @property
    def is_busy(self) -> bool:
        """Whether something is being read."""
        return self._then is not None

    def read(self, work: Callable[[], object], then: Callable[[object], None]) -> None:
        """Read something."""
        self._newest += 1
        self._then = then
        self.busy_changed.emit(True)
        Thread(target=self._work, args=(self._newest, work), name="reading", daemon=True).start()

    def cancel(self) -> None:
        """Drop what is being read: nobody is told of it any more."""
        if self._then is not None:
            self._newest += 1
            self._then = None
            self.busy_changed.emit(False)

    def _work(self, number: int, work: Callable[[], object]) -> None:
        try:
            result, line = work(), ""
        except (SketchterrainError, OSError) as error:
            result, line = None, str(error) or type(error).__name__
        except MemoryError:
            result, line = None, "out of memory"
        try:
            self._finished.emit(number, result, line)
        except RuntimeError:  # the window is gone: nobody waits
            return

    def _finish(self, number: int, result: object, line: str) -> None:
        if number != self._newest or self._then is None:
            return
        then, self._then = self._then, None
        self.busy_changed.emit(False)
        if line:
            self.failed.emit(line)
        else:
            then(result)
