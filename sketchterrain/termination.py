"""SIGTERM, which ends services and jobs of clusters, is heard as Ctrl-C is: nothing is left half-written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def sigterm_as_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt at a SIGTERM; off the main thread, leave signals as they are."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def restore_default_sigterm() -> None:
    """Let a SIGTERM end this process as the system does it."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
