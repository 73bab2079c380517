"""Deferred Ctrl-C and SIGTERM: they take effect between two steps, never within one."""

import signal
import threading
from types import FrameType
from typing import Any


class Interrupts:
    """Defer the first signal until `check`; a second one raises at once. Other threads get no signals."""

    def __init__(self) -> None:
        self.heard = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> "Interrupts":
        if threading.current_thread() is threading.main_thread():
            for each in (signal.SIGINT, signal.SIGTERM):
                self._before[each] = signal.signal(each, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        for each, before in self._before.items():
            signal.signal(each, before)

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal came."""
        if self.heard:
            raise KeyboardInterrupt

    def _hear(self, _: int, __: FrameType | None) -> None:
        if self.heard:
            raise KeyboardInterrupt
        self.heard = True
