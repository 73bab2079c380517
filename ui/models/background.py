"""Work beside the window, one thing after the other; newer work takes the place of older that waits."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from queue import SimpleQueue
from threading import Condition, Thread

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.errors import SketchterrainError, one_line

_Job = tuple[Callable[[], object], Callable[[str], None]]


class Background(QObject):
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
