"""Keeping unsaved work in case of a crash: recovery files, their locks, the timer."""

from __future__ import annotations

import json
import os
import secrets
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import IO

from PyQt6.QtCore import QObject, QTimer, pyqtSignal

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import pack_sketch
from sketchterrain.io.files import write_atomic
from sketchterrain.io.system import lock_file
from sketchterrain.ui.models.background import BackgroundQueue
from sketchterrain.ui.models.document import Document

_ABOUT = "recovery.json"


@dataclass(frozen=True)
class Recovery:
    """A sketch that a program kept, and did not come to save.

    Attributes
    ----------
    path : Path
        A ``*.sketch`` file that can be loaded.
    name : str
        What the sketch is called.
    when : datetime
        When it was kept.
    original : Path or None
        Where it had been saved before.
    """

    path: Path
    name: str
    when: datetime
    original: Path | None

    @property
    def was_saved_since(self) -> bool:
        """Whether the sketch that it had been saved as was written to later: it may hold all of this."""
        if self.original is None:
            return False
        try:
            files = self.original.iterdir() if self.original.is_dir() else [self.original]
            times = [each.stat().st_mtime for each in files if each.is_file()]
        except OSError:  # it is out of reach now
            return False
        return max(times, default=0.0) > self.when.timestamp()


class Lock:
    """Held by one program at a time; it goes with the program, however that ends."""

    def __init__(self, path: Path) -> None:
        self._path = path.with_suffix(".lock")
        self._file = self._opened()
        while not self._is_there():  # whoever held it removed it meanwhile
            self._file.close()
            self._file = self._opened()

    def release(self) -> None:
        """Let others have it."""
        self._file.close()

    def remove(self) -> None:
        """Let it go, for what it guarded is no more."""
        self._path.unlink(missing_ok=True)
        self._file.close()

    def _opened(self) -> IO[bytes]:
        file = self._path.open("ab")
        try:
            lock_file(file.fileno())
        except OSError:
            file.close()
            raise
        return file

    def _is_there(self) -> bool:
        try:
            return self._path.stat().st_ino == os.fstat(self._file.fileno()).st_ino
        except FileNotFoundError:
            return False


def new_recovery_path(folder: Path) -> Path:
    """Return a name in a folder under which no other program keeps a sketch."""
    return folder / f"{os.getpid()}-{secrets.token_hex(4)}.sketch"


def write_recovery(path: Path, sketch: Sketch, original: Path | None) -> None:
    """Keep a sketch, whole or not at all."""
    about = {
        "name": sketch.name,
        "when": datetime.now(UTC).isoformat(),
        "original": None if original is None else str(original.absolute()),
    }
    write_atomic(path, pack_sketch(sketch, extra_files={_ABOUT: json.dumps(about).encode("utf-8")}))


def read_recovery(path: Path) -> Recovery | None:
    """Return what is known of a sketch that was kept; None if it is none of ours, or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            about = json.loads(archive.read(_ABOUT))
        original = about["original"]
        when = datetime.fromisoformat(about["when"])
        return Recovery(path, str(about["name"]), when, None if original is None else Path(original))
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
        return None


def recovery_paths(folder: Path) -> list[Path]:
    """Return where programs keep sketches in a folder, or were about to; dead ones and living ones."""
    return sorted(
        {path.with_suffix(".sketch") for kind in ("sketch", "lock") for path in folder.glob(f"*.{kind}")}
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
        self._path = new_recovery_path(folder)
        self._lock: Lock | None = None
        self._background = BackgroundQueue(self)
        self._kept: Sketch | None = None
        self._claimed: dict[Path, Lock] = {}
        self._leaving: list[Path] = []
        self._has_failed = False
        self._interval, self._pause = QTimer(self), QTimer(self)
        for timer, seconds in ((self._interval, interval_s), (self._pause, min(_PAUSE, interval_s))):
            timer.setSingleShot(True)
            timer.setInterval(round(1000 * seconds))
            timer.timeout.connect(self.save_now)
        document.sketch_changed.connect(self._wait)
        document.saved_changed.connect(self._wait)
        document.opened.connect(self.save_now)

    @property
    def path(self) -> Path:
        """Where the document is kept, when it is."""
        return self._path

    def recoverable(self) -> list[Recovery]:
        """Return what programs that ended before their time have kept, the newest first.

        It belongs to this program then, until it is discarded or this program ends.
        """
        found = []
        for path in recovery_paths(self._folder):
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

    def save_now(self) -> None:
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
        self._document.opened.disconnect(self.save_now)
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
            self.save_now()

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
