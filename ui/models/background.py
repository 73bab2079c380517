"""Background threads of the window: reading, saving, a queue in which newer work replaces pending work."""

from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from threading import Condition, Thread

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.document.history import History
from sketchterrain.document.store import save_sketch
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.ui.models.document import Document


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
        self._then: Callable[[object], None] | None = None
        self._finished.connect(self._finish)

    @property
    def is_busy(self) -> bool:
        """Whether something is being read."""
        return self._then is not None

    def read(self, work: Callable[[], object], then: Callable[[object], None]) -> None:
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

    busy_changed = pyqtSignal(bool)
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
            starts = not self._open
            self._open += purpose not in self._pending
            self._pending.pop(purpose, None)
            self._pending[purpose] = work, then
            if self._thread is None:
                self._thread = Thread(target=self._work, name="background", daemon=True)
                self._thread.start()
        if starts:
            self.busy_changed.emit(True)

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
            if not self._open:
                self.busy_changed.emit(False)


class SketchSaver(QObject):
    """Saves a document's sketch atomically in the background."""

    saved = pyqtSignal(object)  # Path
    failed = pyqtSignal(str)  # error in one line; the previous file is intact
    busy_changed = pyqtSignal(bool)

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._background = BackgroundQueue(self)
        self._background.busy_changed.connect(self.busy_changed)
        self._succeeded = True

    @property
    def is_busy(self) -> bool:
        """Whether a save is running."""
        return self._background.is_busy

    def save(self, path: Path) -> None:
        """Save the sketch as it is now, without the current stroke."""
        sketch, state = self._document.sketch, self._document.state
        work, then = partial(save_sketch, sketch, path), partial(self._finish, state, path)
        self._background.do(path.absolute(), work, then)

    def wait(self) -> bool:
        """Block until all saves are done; return whether the last one succeeded."""
        self._background.wait()
        return self._succeeded

    def _finish(self, state: tuple[History, object], path: Path, line: str) -> None:
        self._succeeded = not line
        if line:
            self.failed.emit(line)
        else:
            self._document.mark_saved(state, path)
            self.saved.emit(path)
