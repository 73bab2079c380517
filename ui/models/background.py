"""Background work of the window: reading, saving, a queue of replaceable work, autosave, recovery files."""

from __future__ import annotations

import json
import os
import secrets
import zipfile
from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from threading import Condition, Thread
from typing import TYPE_CHECKING, Any, TypeVar

from PyQt6.QtCore import QObject, QTimer, pyqtSignal

from sketchterrain.document.history import History
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import CHANGED, Hashes, file_hashes, pack_sketch, save_unless_changed
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.io.files import write_atomic
from sketchterrain.io.system import lock_file

if TYPE_CHECKING:  # it reads files in the background itself
    from sketchterrain.ui.models.document import Document  # which holds it


_T = TypeVar("_T")


def single_shot(parent: QObject, milliseconds: int, on_timeout: Callable[[], object]) -> QTimer:
    """Return a single-shot timer that is not yet started."""
    timer = QTimer(parent)
    timer.setSingleShot(True)
    timer.setInterval(milliseconds)
    timer.timeout.connect(on_timeout)
    return timer


def _run(work: Callable[[], object]) -> tuple[object, str]:
    """Return the result of some work, and an error in one line or nothing."""
    try:
        return work(), ""
    except (SketchterrainError, OSError) as error:
        return None, one_line(error) or type(error).__name__
    except MemoryError:
        return None, "out of memory"
    except Exception as error:  # noqa: BLE001 # a defect: the caller must learn that it failed
        return None, one_line(f"{type(error).__name__}: {error}")


class BackgroundReader(QObject):
    """Reads one thing at a time; a newer request replaces a running one, whose result is dropped."""

    failed = pyqtSignal(str)  # error in one line
    busy_changed = pyqtSignal(bool)
    _finished = pyqtSignal(int, object, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._newest = 0
        self._then: Callable[[Any], object] | None = None
        self._finished.connect(self._finish)

    @property
    def is_busy(self) -> bool:
        return self._then is not None

    def read(self, work: Callable[[], _T], then: Callable[[_T], object]) -> None:
        """Run `work` on a thread and pass its result to `then` on this one."""
        self._newest += 1
        self._then = then
        self.busy_changed.emit(True)
        Thread(target=self._work, args=(self._newest, work), name="reading", daemon=True).start()

    def cancel(self) -> None:
        """Drop the running request."""
        if self._then is not None:
            self._newest += 1
            self._then = None
            self.busy_changed.emit(False)

    def _work(self, number: int, work: Callable[[], object]) -> None:
        result, line = _run(work)
        with suppress(RuntimeError):  # the window has been deleted
            self._finished.emit(number, result, line)

    def _finish(self, number: int, result: object, line: str) -> None:
        if number != self._newest or self._then is None:
            return
        then, self._then = self._then, None
        self.busy_changed.emit(False)
        if line:
            self.failed.emit(line)
        else:
            then(result)


_Job = tuple[Callable[[], object], Callable[[str], None]]


class BackgroundQueue(QObject):
    """Runs work on a thread that lives while there is work."""

    _done = pyqtSignal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._pending: dict[Hashable, _Job] = {}
        self._changed = Condition()
        self._thread: Thread | None = None
        self._results: SimpleQueue[tuple[Callable[[str], None], str]] = SimpleQueue()
        self._open = 0
        self._done.connect(self._report)

    @property
    def is_busy(self) -> bool:
        """Whether work is running or its callback is outstanding."""
        return self._open > 0

    def do(self, purpose: Hashable, work: Callable[[], object], then: Callable[[str], None]) -> None:
        """Queue work in place of pending work for the same purpose; `then` gets an error line or ""."""
        with self._changed:
            self._open += purpose not in self._pending
            self._pending.pop(purpose, None)
            self._pending[purpose] = work, then
            if self._thread is None:
                self._thread = Thread(target=self._work, name="background", daemon=True)
                self._thread.start()

    def wait(self) -> None:
        """Block until all work is done and its callbacks have run."""
        with self._changed:
            self._changed.wait_for(lambda: self._thread is None)
        self._report()

    def _work(self) -> None:
        while True:
            with self._changed:
                if not self._pending:
                    self._thread = None
                    self._changed.notify_all()
                    return
                work, then = self._pending.pop(next(iter(self._pending)))
            self._results.put((then, _run(work)[1]))
            with suppress(RuntimeError):  # the window has been deleted; pending work is done all the same
                self._done.emit()

    def _report(self) -> None:
        while not self._results.empty():
            then, line = self._results.get()
            self._open -= 1
            then(line)


class SketchSaver(QObject):
    """Saves a document's sketch atomically in the background."""

    saved = pyqtSignal(object)  # Path
    failed = pyqtSignal(str)  # error in one line; the previous file is intact
    refused = pyqtSignal(object)  # Path that another program has changed

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._background = BackgroundQueue(self)
        self._succeeded = True

    @property
    def is_busy(self) -> bool:
        return self._background.is_busy

    def save(self, path: Path) -> None:
        """Save the sketch as it is now, without the current stroke, unless the file was changed meanwhile."""
        document, then = self._document, partial(self._finish, self._document.state, path)
        work = partial(save_unless_changed, document.sketch, path, document.known_files)
        self._background.do(path.absolute(), work, then)

    def wait(self) -> bool:
        """Block until all saves are done; return whether the last one succeeded."""
        while self.is_busy:  # twice if a refused save is repeated
            self._background.wait()
        return self._succeeded

    def _finish(self, state: tuple[History, object], path: Path, line: str) -> None:
        self._succeeded = not line
        if line == CHANGED and not self.is_busy and state[0] is self._document.history:
            self.refused.emit(path)
        elif line:
            self.failed.emit(line)
        else:
            self._document.mark_saved(state, path)
            self.saved.emit(path)


_METADATA = "recovery.json"
_PAUSE = 2.0  # s without a change after which the document is written; never more than the interval


@dataclass(frozen=True)
class Recovery:
    """A recovery file: a loadable `path`, the sketch's name, its time, and its own file with its hashes."""

    path: Path
    name: str
    when: datetime
    original: Path | None
    files: Hashes

    @property
    def was_saved_since(self) -> bool:
        """Whether the sketch's own file has changed since."""
        return self.original is not None and file_hashes(self.original) not in ({}, self.files)


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


def write_recovery(path: Path, sketch: Sketch, original: Path | None, files: Hashes) -> None:
    """Write a recovery file atomically."""
    metadata = {
        "name": sketch.name,
        "when": datetime.now(UTC).isoformat(),
        "original": None if original is None else str(original.absolute()),
        "files": files,
    }
    write_atomic(path, pack_sketch(sketch, extra_files={_METADATA: json.dumps(metadata).encode("utf-8")}))


def read_recovery(path: Path) -> Recovery | None:
    """Return a recovery file's description; None if it is foreign or damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            metadata = json.loads(archive.read(_METADATA))
        original, when = metadata["original"], datetime.fromisoformat(metadata["when"])
        original = None if original is None else Path(original)
        return Recovery(path, str(metadata["name"]), when, original, metadata.get("files", {}))
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
        self._interval, self._pause = (
            single_shot(self, round(1000 * seconds), self.save_now)
            for seconds in (interval_s, min(_PAUSE, interval_s))
        )
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
            path, known = self._document.path, self._document.known_files
            write = partial(self._write, sketch, path, known.get(path, {}))
            self._background.do("write", write, self._finish)

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

    def _write(self, sketch: Sketch, original: Path | None, files: Hashes) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        if self._lock is None:
            self._lock = Lock(self.path)
        write_recovery(self.path, sketch, original, files)

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
