"""Progress of a command on stderr: bars on a terminal, elsewhere a line for each slow stage."""

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

_SLOW = 1.0  # s until a stage is printed without a terminal


class Stages:
    """Timed stages of a command, a context manager; `show` replaces output on stderr.

    `show` takes a stage's title and returns a context that yields a callback for the share that is done.
    """

    def __init__(self, show: Show | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._start = time.perf_counter()
        self._bars: Progress | None = _bars() if show is None and sys.stderr.isatty() else None
        self._show: Show = show or self._show_on_stderr

    def __enter__(self) -> Stages:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    @property
    def elapsed(self) -> float:
        """Wall time since creation, s."""
        return time.perf_counter() - self._start

    @contextmanager
    def stage(self, name: str, title: str) -> Iterator[Callable[[float], None]]:
        """Show and time a stage, by `name` in `seconds`; yield a callback for the share done, 0 … 1."""
        start = time.perf_counter()
        with self._show(title) as progress:
            yield progress
        self.seconds[name] = time.perf_counter() - start

    @contextmanager
    def _show_on_stderr(self, title: str) -> Iterator[Callable[[float], None]]:
        if self._bars is None:
            slow = Timer(_SLOW, sys.stderr.write, [f"{title} …\n"])
            slow.daemon = True
            slow.start()
            try:
                yield lambda _: None
            finally:
                slow.cancel()
                slow.join()  # so that lines do not interleave
            return
        bars = self._bars
        task = bars.add_task(title, total=None)
        yield lambda share: bars.update(task, total=1.0, completed=share)
        bars.update(task, total=1.0, completed=1.0)


def _bars() -> Progress:
    # Importing rich takes 0.1 s.
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<28}", markup=False), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=Console(stderr=True))
