"""Console output: error lines with exit codes, and progress on stderr."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Any

import typer

from sketchterrain.errors import InputError, SketchterrainError, one_line

if TYPE_CHECKING:
    from rich.progress import Progress

    ShowStage = Callable[[str], AbstractContextManager[Callable[[float], None]]]

FAILED = 1
PARTIAL = 5
INTERRUPTED = 130
DEBUG = "SKETCHTERRAIN_DEBUG"
"""Environment variable that enables tracebacks."""
USAGE_ERROR: Any = typer.BadParameter.__base__
"""Base of all usage errors, in every version of typer and click."""


def describe_error(error: Exception) -> tuple[str, int]:
    """Return the message of an error and its exit code."""
    if isinstance(error, USAGE_ERROR):
        return error.format_message(), error.exit_code
    if isinstance(error, SketchterrainError):
        return str(error), error.exit_code
    if isinstance(error, OSError):
        reason = error.strerror or str(error)
        return (f"{error.filename}: {reason}" if error.filename else reason), FAILED
    if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
        return f"{error.object[-200:]}: expected a name in UTF-8", InputError.exit_code
    if isinstance(error, MemoryError):
        return "out of memory", FAILED
    kind = type(error).__name__
    return f"unexpected {kind}: {error}; please report it, with the traceback of {DEBUG}=1", FAILED


def fail(message: str, code: int) -> int:
    """Write one line to stderr and return the exit code."""
    with suppress(OSError):
        sys.stderr.write(f"sketchterrain: error: {one_line(' '.join(message.split()))}\n")
    return code


def print_note(*lines: str) -> None:
    """Write notes to stderr, a line each."""
    sys.stderr.writelines(f"sketchterrain: note: {one_line(line)}\n" for line in lines)


@contextmanager
def standard_streams() -> Iterator[None]:
    """Open missing standard streams (``>&-``), and flush stdout at the end; exit if it cannot be written."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:  # the next file would get what drivers print
        os.set_inheritable(number, True)
    os.close(number)
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("r+", encoding="utf-8"))  # noqa: SIM115 # kept
        elif hasattr(getattr(sys, name), "reconfigure"):  # a terminal without a character must not raise
            getattr(sys, name).reconfigure(errors="replace")
    try:
        yield
    finally:
        try:
            sys.stdout.flush()
        except OSError as error:
            with suppress(OSError):  # the interpreter would try again, and exit with 120
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            if not isinstance(error, BrokenPipeError):
                raise SystemExit(fail(f"stdout: {error.strerror}", FAILED)) from None


_SLOW = 1.0  # s until a stage is printed without a terminal


class Stages:
    """Timed stages of a command, a context manager; `show` replaces output on stderr.

    `show` takes a stage's title and returns a context that yields a callback for the share that is done.
    `costs` of stages, relative to each other, are hints for the whole command's share and remaining time.
    """

    def __init__(self, show: ShowStage | None = None, costs: Mapping[str, float] | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._costs, self._done = costs or {}, dict[str, float]()
        self._whole: Any = None  # the line of the whole command
        self._start = time.perf_counter()
        self._bars: Progress | None = progress_bars() if show is None and sys.stderr.isatty() else None
        self._show: ShowStage = show or self._show_on_stderr

    def __enter__(self) -> Stages:
        if self._bars is not None:
            self._bars.start()
            if self._costs:
                self._whole = self._bars.add_task("All", total=sum(self._costs.values()))
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

            def report(share: float) -> None:
                progress(share)
                self._count(name, share)

            yield report
        self._count(name, 1.0)
        self.seconds[name] = time.perf_counter() - start

    def _count(self, name: str, share: float) -> None:
        if self._bars is not None and name in self._costs:
            self._done[name] = share * self._costs[name]
            self._bars.update(self._whole, completed=sum(self._done.values()))

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


def progress_bars() -> Progress:
    """Return progress bars on stderr with shares and remaining times, disabled without a terminal."""
    # Importing rich takes 0.1 s.
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    return Progress(
        TextColumn("{task.description:<28}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True, markup=False, emoji=False, highlight=False, soft_wrap=True),
        disable=not sys.stderr.isatty(),
        speed_estimate_period=3600.0,
    )


def pluralize(count: int, noun: str) -> str:
    """Return a count and its noun: ``1 shape``, ``2 shapes``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
