"""What is being done, told on stderr and timed: bars on a terminal, a line a slow stage elsewhere."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from threading import Timer
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager

    from rich.progress import Progress

    Show = Callable[[str], AbstractContextManager[Callable[[float], None]]]

_QUIET = 1.0  # s until a stage is worth a line in a log


class Stages:
    """The stages of one command, in the order they are done.

    Use it as a context manager: a bar must be taken off the terminal however the command ends.
    """

    def __init__(self, show: Show | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._start = time.perf_counter()
        self._bars: Progress | None = _bars() if show is None and sys.stderr.isatty() else None
        self._show: Show = show or self._told

    def __enter__(self) -> Stages:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    @property
    def elapsed(self) -> float:
        """Wall time since the first stage could begin, s."""
        return time.perf_counter() - self._start

    @contextmanager
    def stage(self, name: str, title: str) -> Iterator[Callable[[float], None]]:
        """Time what is done within this context and tell that it is being done."""
        start = time.perf_counter()
        with self._show(title) as tell:
            yield tell
        self.seconds[name] = time.perf_counter() - start

    @contextmanager
    def _told(self, title: str) -> Iterator[Callable[[float], None]]:
        if self._bars is None:
            slow = Timer(_QUIET, sys.stderr.write, [f"{title} …\n"])
            slow.daemon = True
            slow.start()
            try:
                yield lambda _: None
            finally:
                slow.cancel()
                slow.join()  # a line that is being written is written before the next one
            return
        bars = self._bars
        task = bars.add_task(title, total=None)
        yield lambda share: bars.update(task, total=1.0, completed=share)
        bars.update(task, total=1.0, completed=1.0)


def _bars() -> Progress:
    # Only a terminal needs rich, and its import takes a tenth of a second.
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<28}", markup=False), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=Console(stderr=True))
