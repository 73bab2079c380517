"""Progress of a world: a bar on a terminal, a line now and then elsewhere, or callbacks."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sketchterrain.errors import one_line
from sketchterrain.estimate import duration
from sketchterrain.world.resume import Broken
from sketchterrain.world.tasks import TaskResult

_INTERVAL: Final = 10.0  # s between two lines, where there is no terminal
_NAMED: Final = 10  # broken files; --json has them all


class ProgressReporter:
    """Reports the progress of a run to a person; a context manager.

    `show` takes what is being done, the share that is done and the time left as text, `echo` a line that
    stays; by default both go to stderr.
    """

    def __init__(
        self,
        *,
        show: Callable[[str, float, str], None] | None = None,
        echo: Callable[[str], None] | None = None,
        timer: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._timer = timer
        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            disable=show is not None or not sys.stderr.isatty(),
        )
        self._row = self._bar.add_task("", total=1.0)
        self._show, self._echo = show or self._show_on_stderr, echo or self._echo_on_stderr
        self._shown = self._start = timer()
        self._tasks = self._done = self._present = self._broken = 0

    def __enter__(self) -> ProgressReporter:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def verified(self, share: float) -> None:
        """Show the share of the existing files that is verified."""
        self._show("Verifying", share, "")

    def broken(self, file: Broken) -> None:
        """Report a missing or changed file, which is made again; of many only their number."""
        self._broken += 1
        if self._broken <= _NAMED:
            self._echo(f"{one_line(file.file)} {file.why}: is made again")

    def began(self, tasks: int, done: int) -> None:
        """Report how many of all tasks are done before the first one is run."""
        if self._broken > _NAMED:
            self._echo(f"and {self._broken - _NAMED} more files are made again")
        if done:
            self._echo(f"{done} of {tasks} shards are done and verified")
        self._tasks, self._done, self._present, self._start = tasks, done, done, self._timer()
        self._bar.reset(self._row, total=tasks, completed=done)

    def made(self, made: TaskResult) -> None:
        """Show that a task is done, and about how long the others take."""
        self._done += 1
        elapsed, left = self._timer() - self._start, self._tasks - self._done
        seconds = elapsed * left / (self._done - self._present)
        self._show(
            f"{self._done} of {self._tasks} shards",
            self._done / self._tasks,
            f"about {duration(seconds)} left" if left else "",
        )

    def joined(self, share: float) -> None:
        """Show the share of the joined files that is written."""
        self._show("Joining", share, "")

    def note(self, line: str) -> None:
        """Report what happened to devices and workers."""
        self._echo(f"sketchterrain: note: {one_line(line)}")

    def _show_on_stderr(self, text: str, share: float, left: str) -> None:
        if not self._bar.disable:
            total = self._bar.tasks[0].total or 1.0
            self._bar.update(self._row, description=text, completed=share * total)
        elif self._timer() - self._shown >= _INTERVAL:
            self._shown = self._timer()
            self._echo(f"{text}: {share:.0%}{left and ', '}{left}")

    def _echo_on_stderr(self, line: str) -> None:
        if self._bar.disable:
            sys.stderr.write(f"{line}\n")
        else:
            self._bar.console.print(line, markup=False, highlight=False)
