"""Ctrl-C and SIGTERM, kept until it is asked for them: they fall between two steps, never amid one."""

from __future__ import annotations

import signal
import threading
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from types import FrameType

__all__ = ["Interrupts"]


class Interrupts:
    """Keeps the first one while its context lasts; a second one, of someone impatient, acts at once.

    In a thread that is not the main one, signals are left as they are.
    """

    def __init__(self) -> None:
        self._heard = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            for each in (signal.SIGINT, signal.SIGTERM):
                self._before[each] = signal.signal(each, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        for each, before in self._before.items():
            signal.signal(each, before)

    @property
    def heard(self) -> bool:
        """Whether one came."""
        return self._heard

    def check(self) -> None:
        """Let one that came act now.

        Raises
        ------
        KeyboardInterrupt
            If one came.
        """
        if self._heard:
            raise KeyboardInterrupt

    def _hear(self, _: int, __: FrameType | None) -> None:
        if self._heard:
            raise KeyboardInterrupt
        self._heard = True
