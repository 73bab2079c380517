"""Work beside the window on threads: reading files, saving, a queue whose newest work wins."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from threading import Condition, Thread

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import save_sketch
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.ui.models.document import Document


class BackgroundReader(QObject):
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


_Job = tuple[Callable[[], object], Callable[[str], None]]


class BackgroundQueue(QObject):
    """Does what it is asked on a thread that lives while there is something to do.

    Parameters
    ----------
    parent
    """

    busy_changed = pyqtSignal(bool)
    _done = pyqtSignal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._waiting: dict[Hashable, _Job] = {}
        self._changed = Condition()
        self._thread: Thread | None = None
        self._results: SimpleQueue[tuple[Callable[[str], None], str]] = SimpleQueue()
        self._open = 0
        self._done.connect(self._tell)

    @property
    def is_busy(self) -> bool:
        """Whether something is being done, or its end was not told yet."""
        return self._open > 0

    def do(self, purpose: Hashable, work: Callable[[], object], then: Callable[[str], None]) -> None:
        """Do something after what waits already; what waits for the same purpose is not done any more.

        Parameters
        ----------
        purpose
        work
            Called on another thread; may raise `SketchterrainError`, `OSError` or `MemoryError`.
        then
            Called on this thread afterwards, with why it failed in one line, or nothing.
        """
        with self._changed:
            begins = not self._open
            self._open += purpose not in self._waiting
            self._waiting.pop(purpose, None)
            self._waiting[purpose] = work, then
            if self._thread is None:
                self._thread = Thread(target=self._run, name="background", daemon=True)
                self._thread.start()
        if begins:
            self.busy_changed.emit(True)

    def wait(self) -> None:
        """Block until all is done and told."""
        with self._changed:
            self._changed.wait_for(lambda: self._thread is None)
        self._tell()

    def _run(self) -> None:
        while True:
            with self._changed:
                if not self._waiting:
                    self._thread = None
                    self._changed.notify_all()
                    return
                work, then = self._waiting.pop(next(iter(self._waiting)))
            self._results.put((then, _failure(work)))
            try:
                self._done.emit()
            except RuntimeError:  # the window is gone, nobody listens; what waits is done all the same
                continue

    def _tell(self) -> None:
        while not self._results.empty():
            then, line = self._results.get()
            self._open -= 1
            then(line)
            if not self._open:
                self.busy_changed.emit(False)


def _failure(work: Callable[[], object]) -> str:
    try:
        work()
    except (SketchterrainError, OSError) as error:
        return one_line(error) or type(error).__name__
    except MemoryError:
        return "out of memory"
    except Exception as error:  # noqa: BLE001 # a defect of ours: who waits must hear that it failed
        return one_line(f"{type(error).__name__}: {error}")
    return ""


class SketchSaver(QObject):
    """Writes a document's sketch, whole or not at all, while a person works on."""

    saved = pyqtSignal(object)
    """The `Path` where the sketch is saved now."""
    failed = pyqtSignal(str)
    """Why it could not be saved, one line; what was there before is there still."""
    busy_changed = pyqtSignal(bool)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._background = BackgroundQueue(self)
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
            self._document.mark_saved(sketch, path)
            self.saved.emit(path)
