"""Workers of this machine, each a process, with a scheduler in this one."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.world.quiet import LEVEL

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["local_workers"]

_CLOSING = 30.0  # s
_CONFIG = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.use-file-locking": False,
    "distributed.admin.tick.limit": "1 h",  # a machine that is busy is no news
    # How long a worker that died may take to come back before its place is given up.
    "distributed.deploy.lost-worker-timeout": "1 h",
}


@contextmanager
def local_workers(count: int, *, threads: int) -> Iterator[str]:
    """Start workers, and end them however the context is left; yields the scheduler's address.

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
    import dask.config
    from distributed import LocalCluster

    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder, dask.config.set(_CONFIG):
        # Threads and processes inherit what is blocked: a Ctrl-C on the terminal is for this process alone.
        with _interrupts_blocked():
            try:
                cluster = LocalCluster(
                    n_workers=0,
                    threads_per_worker=threads,
                    processes=True,
                    dashboard_address=None,
                    worker_dashboard_address=None,
                    memory_limit=None,
                    silence_logs=LEVEL,
                    local_directory=folder,
                )
            except (OSError, RuntimeError) as error:
                raise SketchterrainError(f"workers cannot be started: {one_line(error)}") from error
        try:
            cluster.scale(count)
            yield str(cluster.scheduler_address)
        finally:
            with suppress(TimeoutError):
                cluster.close(timeout=_CLOSING)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread() or os.name != "posix":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
