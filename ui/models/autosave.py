"""Autosave: recovery files of unsaved work, their locks and the timer."""

import json
import os
import secrets
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from PyQt6.QtCore import QObject, QTimer, pyqtSignal

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import pack_sketch
from sketchterrain.io.files import write_atomic
from sketchterrain.io.system import lock_file
from sketchterrain.ui.models.background import BackgroundQueue
from sketchterrain.ui.models.document import Document

_METADATA = "recovery.json"
_PAUSE = 2.0  # s without a change after which the document is written; never more than the interval


@dataclass(frozen=True)
class Recovery:
    """A recovery file: a loadable `path`, the sketch's name, its time, and the path it was last saved at."""

    path: Path
    name: str
    when: datetime
    original: Path | None

    @property
    def was_saved_since(self) -> bool:
        """Whether the sketch's own file is newer than the recovery file."""
        if self.original is None:
            return False
        try:
            files = self.original.iterdir() if self.original.is_dir() else [self.original]
            times = [each.stat().st_mtime for each in files if each.is_file()]
        except OSError:  # not accessible
            return False
        return max(times, default=0.0) > self.when.timestamp()


class Lock:
    """An exclusive file lock, released when its process ends; OSError if another process holds it."""

    def __init__(self, path: Path) -> None:
        self._path = path.with_suffix(".lock")
        self._file = self._path.open("ab")
        try:
            lock_file(self._file.fileno())
        except OSError:
            self._file.close()
            raise

    def release(self) -> None:
        self._file.close()

    def remove(self) -> None:
        """Delete the lock file and release the lock."""
        self._path.unlink(missing_ok=True)
        self._file.close()


def new_recovery_path(folder: Path) -> Path:
    """Return an unused recovery path in a folder."""
    return folder / f"{os.getpid()}-{secrets.token_hex(4)}.sketch"


def write_recovery(path: Path, sketch: Sketch, original: Path | None) -> None:
    """Write a recovery file atomically."""
    metadata = {
        "name": sketch.name,
        "when": datetime.now(UTC).isoformat(),
        "original": None if original is None else str(original.absolute()),
    }
    write_atomic(path, pack_sketch(sketch, extra_files={_METADATA: json.dumps(metadata).encode("utf-8")}))


def read_recovery(path: Path) -> Recovery | None:
    """Return a recovery file's description; None if it is foreign or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            metadata = json.loads(archive.read(_METADATA))
        original, when = metadata["original"], datetime.fromisoformat(metadata["when"])
        return Recovery(path, str(metadata["name"]), when, None if original is None else Path(original))
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
        return None


class Autosave(QObject):
    """Writes a modified document to a recovery file in the background; removes it once saved.

    A change is written at most `interval_s` seconds after it was made, sooner if the user pauses.
    """

    failed = pyqtSignal(str)  # error in one line, once until writing succeeds again

    def __init__(self, document: Document, folder: Path, *, interval_s: float = 20.0) -> None:
        super().__init__()
        self._document = document
        self._folder = folder
        self.path = new_recovery_path(folder)
        self._lock: Lock | None = None
        self._background = BackgroundQueue(self)
        self._written: Sketch | None = None
        self._claimed: dict[Path, Lock] = {}
        self._discarded: list[Path] = []
        self._has_failed = False
        self._interval, self._pause = QTimer(self), QTimer(self)
        for timer, seconds in ((self._interval, interval_s), (self._pause, min(_PAUSE, interval_s))):
            timer.setSingleShot(True)
            timer.setInterval(round(1000 * seconds))
            timer.timeout.connect(self.save_now)
        document.sketch_changed.connect(self._schedule)
        document.saved_changed.connect(self._schedule)
        document.opened.connect(self.save_now)

    def recoverable(self) -> list[Recovery]:
        """Return the recovery files of crashed instances, newest first, and lock them."""
        paths = {
            path.with_suffix(".sketch")
            for kind in ("sketch", "lock")
            for path in self._folder.glob(f"*.{kind}")
        }
        found = []
        for path in sorted(paths):
            if path == self.path or not (path in self._claimed or self._claim(path)):
                continue
            recovery = read_recovery(path)
            if recovery is not None:
                found.append(recovery)
            elif not path.exists():  # it crashed before the first write
                self._claimed.pop(path).remove()
        return sorted(found, key=lambda each: each.when, reverse=True)

    def discard(self, recovery: Recovery) -> None:
        """Remove a recovery file; if it was opened, once this document's own is written."""
        self._discarded.append(recovery.path)
        if not self._background.is_busy:
            self._remove_discarded()

    def save_now(self) -> None:
        """Write the recovery file in the background, or remove it if nothing is modified."""
        self._interval.stop()
        self._pause.stop()
        sketch = self._document.sketch
        if not self._document.is_modified:
            if self._written is not None or self._background.is_busy:
                self._written = None
                self._background.do("write", partial(self.path.unlink, missing_ok=True), self._finish)
        elif sketch is not self._written:
            self._written = sketch
            self._background.do("write", partial(self._write, sketch, self._document.path), self._finish)

    def wait(self) -> None:
        """Block until pending writes are done."""
        self._background.wait()

    def close(self) -> None:
        """Remove this document's recovery file and release locks."""
        self._document.sketch_changed.disconnect(self._schedule)
        self._document.saved_changed.disconnect(self._schedule)
        self._document.opened.disconnect(self.save_now)
        self._interval.stop()
        self._pause.stop()
        self._background.do("write", partial(self.path.unlink, missing_ok=True), self._finish)
        self._background.wait()
        if self._lock is not None:
            self._lock.remove()
            self._lock = None
        for lock in self._claimed.values():
            lock.release()
        self._claimed.clear()

    def _schedule(self) -> None:
        if self._document.is_modified:
            if not self._interval.isActive():
                self._interval.start()
            self._pause.start()
        else:
            self.save_now()

    def _write(self, sketch: Sketch, original: Path | None) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        if self._lock is None:
            self._lock = Lock(self.path)
        write_recovery(self.path, sketch, original)

    def _finish(self, line: str) -> None:
        if line:
            self._written = None
            if not self._has_failed:
                self.failed.emit(line)
        self._has_failed = bool(line)
        if not line and not self._background.is_busy:
            self._remove_discarded()

    def _claim(self, path: Path) -> bool:
        with suppress(OSError):  # its program runs, or another one has claimed it
            self._claimed[path] = Lock(path)
        return path in self._claimed

    def _remove_discarded(self) -> None:
        for path in self._discarded:
            path.unlink(missing_ok=True)
            lock = self._claimed.pop(path, None)
            if lock is not None:
                lock.remove()
        self._discarded.clear()
