"""Workers of this machine, each a process, with a scheduler in this one; one that dies is started again."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.world.quiet import LEVEL

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["LocalWorkers", "local_workers"]

_CLOSING = 10.0  # s
_LOOK = 0.2  # s between two looks at whether all are alive
_MODULE = "sketchterrain.world.local_worker"


class LocalWorkers:
    """Processes that work for a scheduler; each keeps its name when it is started again.

    Parameters
    ----------
    address
        Of the scheduler.
    count
        How many.
    threads
        Tasks that each takes at once.
    folder
        Where they may leave files of their own.
    """

    def __init__(self, address: str, count: int, *, threads: int, folder: Path) -> None:
        self.address = address
        self._threads, self._folder = threads, folder
        self._ending = Event()
        self._processes = [self._started(number) for number in range(count)]
        self._thread = Thread(target=self._keep_alive, name="workers", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End them."""
        self._ending.set()
        self._thread.join()
        for process in self._processes:
            if process.stdin is not None:
                process.stdin.close()
        for process in self._processes:
            with suppress(subprocess.TimeoutExpired):
                process.wait(_CLOSING)
                continue
            process.kill()
            process.wait()

    def told(self) -> str:
        """Return the last line that a worker wrote on stderr; empty where none wrote any."""
        for log in sorted(self._folder.glob("*.log")):
            lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
            if written := [line for line in lines if line.strip()]:
                return one_line(written[-1])
        return ""

    def _keep_alive(self) -> None:
        while not self._ending.wait(_LOOK):
            for number, process in enumerate(self._processes):
                if process.poll() is not None:
                    if process.stdin is not None:
                        process.stdin.close()
                    self._processes[number] = self._started(number)

    def _started(self, number: int) -> subprocess.Popen[bytes]:
        folder = self._folder / str(number)
        command = [sys.executable, "-m", _MODULE, self.address, str(number), str(self._threads), str(folder)]
        # The same program, wherever this one was imported from.
        paths = os.pathsep.join(path for path in sys.path if path)
        with (self._folder / f"{number}.log").open("wb") as log:
            return subprocess.Popen(  # noqa: S603 - this program
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=log,
                env={**os.environ, "PYTHONPATH": paths},
                start_new_session=True,  # a terminal's Ctrl-C is for this process alone
            )


@contextmanager
def local_workers(count: int, *, threads: int) -> Iterator[LocalWorkers]:
    """Start workers and a scheduler, and end them however the context is left.

    Parameters
    ----------
    count
        How many processes.
    threads
        Tasks that each takes at once.

    Raises
    ------
    SketchterrainError
        If they cannot be started.
    """
    with tempfile.TemporaryDirectory(prefix="sketchterrain-", ignore_cleanup_errors=True) as folder:
        cluster = _scheduler()
        try:
            workers = _workers(str(cluster.scheduler_address), count, threads, Path(folder))
            try:
                yield workers
            finally:
                workers.close()
        finally:
            with suppress(TimeoutError):
                cluster.close(timeout=_CLOSING)


def _workers(address: str, count: int, threads: int, folder: Path) -> LocalWorkers:
    try:
        return LocalWorkers(address, count, threads=threads, folder=folder)
    except OSError as error:
        raise SketchterrainError(f"workers cannot be started: {error.strerror or error}") from error


def _scheduler() -> Any:
    from distributed import LocalCluster

    try:
        return LocalCluster(n_workers=0, processes=True, dashboard_address=None, silence_logs=LEVEL)
    except (OSError, RuntimeError) as error:
        raise SketchterrainError(f"a scheduler cannot be started: {one_line(error)}") from error
