"""Keeping what is not saved, in case of a crash."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from pathlib import Path

from PyQt6.QtCore import QObject, QTimer, pyqtSignal

from sketchterrain.sketch import Sketch
from sketchterrain.ui.models.background import Background
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.recovery import (
    Lock,
    Recovery,
    new_place,
    places_in,
    read_recovery,
    write_recovery,
)

_PAUSE = 2.0
"""s without another step after which the document is kept; never more than the interval."""


class Autosave(QObject):
    """Keeps a document that is modified in a file, beside the window, and drops that when it is saved.

    A step is kept at most `interval_s` seconds after it was done, and the time that writing takes; sooner if
    the person pauses.
    """

    failed = pyqtSignal(str)
    """Why the document cannot be kept, one line; told once until it works again."""

    def __init__(
        self, document: Document, folder: Path, *, interval_s: float = 20.0, parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._document = document
        self._folder = folder
        self._path = new_place(folder)
        self._lock: Lock | None = None
        self._background = Background(self)
        self._kept: Sketch | None = None
        self._claimed: dict[Path, Lock] = {}
        self._leaving: list[Path] = []
        self._has_failed = False
        self._interval, self._pause = QTimer(self), QTimer(self)
        for timer, seconds in ((self._interval, interval_s), (self._pause, min(_PAUSE, interval_s))):
            timer.setSingleShot(True)
            timer.setInterval(round(1000 * seconds))
            timer.timeout.connect(self.keep)
        document.sketch_changed.connect(self._wait)
        document.saved_changed.connect(self._wait)
        document.opened.connect(self.keep)

    @property
    def path(self) -> Path:
        """Where the document is kept, when it is."""
        return self._path

    def recoverable(self) -> list[Recovery]:
        """Return what programs that ended before their time have kept, the newest first.

        It belongs to this program then, until it is discarded or this program ends.
        """
        found = []
        for path in places_in(self._folder):
            if path == self._path or not (path in self._claimed or self._claim(path)):
                continue
            recovery = read_recovery(path)
            if recovery is not None:
                found.append(recovery)
            elif not path.exists():  # it ended before it kept anything
                self._claimed.pop(path).remove()
        return sorted(found, key=lambda each: each.when, reverse=True)

    def discard(self, recovery: Recovery) -> None:
        """Drop what was recovered. If it was opened, it stays until this program has kept it itself."""
        self._leaving.append(recovery.path)
        if not self._background.is_busy:
            self._leave()

    def keep(self) -> None:
        """Keep the document now, beside the window, or drop what is kept if there is nothing to save."""
        self._interval.stop()
        self._pause.stop()
        sketch = self._document.sketch
        if not self._document.is_modified:
            if self._kept is not None or self._background.is_busy:
                self._kept = None
                self._background.do("keep", partial(self._path.unlink, missing_ok=True), self._finish)
        elif sketch is not self._kept:
            self._kept = sketch
            self._background.do("keep", partial(self._write, sketch, self._document.path), self._finish)

    def wait(self) -> None:
        """Block until what is being kept is kept."""
        self._background.wait()

    def close(self) -> None:
        """Leave nothing of this program behind, and to others what it did not discard."""
        self._document.sketch_changed.disconnect(self._wait)
        self._document.saved_changed.disconnect(self._wait)
        self._document.opened.disconnect(self.keep)
        self._interval.stop()
        self._pause.stop()
        self._background.do("keep", partial(self._path.unlink, missing_ok=True), self._finish)
        self._background.wait()
        if self._lock is not None:
            self._lock.remove()
            self._lock = None
        for lock in self._claimed.values():
            lock.release()
        self._claimed.clear()

    def _wait(self) -> None:
        if self._document.is_modified:
            if not self._interval.isActive():
                self._interval.start()
            self._pause.start()
        else:
            self.keep()

    def _write(self, sketch: Sketch, original: Path | None) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        if self._lock is None:
            self._lock = Lock(self._path)
        write_recovery(self._path, sketch, original)

    def _finish(self, line: str) -> None:
        if line:
            self._kept = None
            if not self._has_failed:
                self.failed.emit(line)
        self._has_failed = bool(line)
        if not line and not self._background.is_busy:
            self._leave()

    def _claim(self, path: Path) -> bool:
        with suppress(OSError):  # its program lives, or another one has claimed it
            self._claimed[path] = Lock(path)
        return path in self._claimed

    def _leave(self) -> None:
        for path in self._leaving:
            path.unlink(missing_ok=True)
            lock = self._claimed.pop(path, None)
            if lock is not None:
                lock.remove()
        self._leaving.clear()
