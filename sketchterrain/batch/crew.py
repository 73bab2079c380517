"""Threads that make the terrains of a batch, several at once, and give up what is in work when told to."""

from __future__ import annotations

import queue
import time
from contextlib import contextmanager
from functools import partial
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from sketchterrain.batch.making import make
from sketchterrain.batch.manifest import Entry, hashed
from sketchterrain.batch.room import PREVIEW_MEMORY, Memory, memory_left, needs_of
from sketchterrain.disk import check_disk
from sketchterrain.errors import one_line
from sketchterrain.exit_codes import told
from sketchterrain.generate import Shared
from sketchterrain.progress import Stages
from sketchterrain.report import rounded

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from sketchterrain.batch.output import Fingerprints, Output
    from sketchterrain.batch.plan import Item
    from sketchterrain.batch.previews import Previews
    from sketchterrain.jobs import Devices

__all__ = ["Crew", "Result", "Watcher"]

_LOOK = 0.2  # s between two looks for Ctrl-C


class Watcher(Protocol):
    """Is told how a batch goes on; calls come from several threads, but never two at once."""

    def checking(self, number: int, items: int) -> None:
        """Tell that it is looked whether an item, of so many, is still there."""

    def begins(self, items: Sequence[Item], skipped: int) -> None:
        """Tell which items will be made, and how many need not."""

    def stage(self, item: Item, title: str) -> None:
        """Tell what is being done for an item."""

    def finished(self, item: Item, entry: Entry) -> None:
        """Tell what came of an item."""

    def stops(self) -> None:
        """Tell that it ends before all is done."""


class Result(NamedTuple):
    """What came of an item."""

    item: Item
    entry: Entry


class _StoppedError(Exception):
    """The batch is to end; what is in work is given up."""


class Crew:
    """Makes items one after the other on each of some threads.

    Parameters
    ----------
    folder
        Of the batch.
    output
        What is written of each item.
    fingerprints
        What an item's files follow from.
    devices
        What they are made on.
    previews
        Where pictures are taken; None: there are none.
    watcher
        Is told each stage.
    """

    def __init__(
        self,
        folder: Path,
        output: Output,
        fingerprints: Fingerprints,
        devices: Devices,
        previews: Previews | None,
        watcher: Watcher,
    ) -> None:
        self._folder, self._output, self._fingerprints = folder, output, fingerprints
        self._devices, self._previews = devices, previews
        self._watcher, self._telling = watcher, Lock()
        self._stop = Event()
        self._memory = Memory(memory_left() - (0 if previews is None else PREVIEW_MEMORY))
        self._waiting: queue.SimpleQueue[Item] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Result | BaseException] = queue.SimpleQueue()
        self._threads: list[Thread] = []

    def start(self, items: Sequence[Item], jobs: int) -> None:
        """Begin to make items, so many at once."""
        for item in items:
            self._waiting.put(item)
        for number in range(min(jobs, len(items))):
            thread = Thread(target=self._work, name=f"terrain-{number}")
            self._threads.append(thread)
            thread.start()

    def next(self, check: Callable[[], None]) -> Result:
        """Wait for the next item that is made or has failed; meanwhile call what may end the waiting."""
        while True:
            check()
            try:
                found = self._results.get(timeout=_LOOK)
            except queue.Empty:
                continue
            if isinstance(found, BaseException):
                raise found
            return found

    def tell(self, result: Result) -> None:
        """Tell the watcher what came of an item."""
        with self._telling:
            self._watcher.finished(*result)

    def end(self, *, early: bool) -> list[Result]:
        """Let what is in work be given up, wait for it, and return what was finished meanwhile.

        Parameters
        ----------
        early
            Whether not all is done; the watcher is told.
        """
        self._stop.set()
        if early:
            with self._telling:
                self._watcher.stops()
        for thread in self._threads:
            thread.join()
        found = []
        while not self._results.empty():
            result = self._results.get()
            if isinstance(result, Result):
                found.append(result)
        return found

    def _work(self) -> None:
        take = None if self._previews is None else partial(self._previews.take, go_on=self._go_on)
        shared = Shared(self._devices, take_picture=take)  # a memory of placing for each thread
        try:
            while not self._stop.is_set():
                try:
                    item = self._waiting.get_nowait()
                except queue.Empty:
                    return
                self._results.put(Result(item, self._made(item, shared)))
        except _StoppedError:
            return
        except BaseException as error:  # noqa: BLE001 - raised again where the batch is waited for
            self._results.put(error)

    def _made(self, item: Item, shared: Shared) -> Entry:
        """Return an item's entry once it is made, or has failed."""
        folder, start = self._folder / item.name, time.perf_counter()
        stages = Stages(lambda title: self._stage(item, title))
        known: dict[str, Any] = {"name": item.name, "sketch": item.source.given, "seed": item.seed}
        known["settings"] = dict(item.settings)
        try:
            sketch = item.sketch
            known["input"] = self._fingerprints.of(sketch)
            needs = needs_of(sketch, self._output)
            with self._memory.room(needs.memory):
                check_disk(self._folder, needs.disk, "files of this terrain")
                stages, start = Stages(lambda title: self._stage(item, title)), time.perf_counter()
                done = make(sketch, folder, self._output, shared=shared, stages=stages)
            return Entry(
                **known,
                state="done" if done.problem is None else "partial",
                files=tuple(hashed(path) for path in done.files),
                seconds=round(time.perf_counter() - start, 4),
                timings=rounded(stages.seconds),
                adherence={key: value for key, value in done.report["adherence"].items() if key != "shapes"},
                notes=tuple(done.report["restarts"]),
                error=one_line(done.problem or ""),
            )
        except _StoppedError:
            _remove_empty(folder)
            raise
        except Exception as error:  # noqa: BLE001 - whatever it is, it stops no other item
            _remove_empty(folder)
            line = one_line(" ".join(told(error)[0].split()))
            took = round(time.perf_counter() - start, 4)
            return Entry(**known, state="failed", seconds=took, timings=rounded(stages.seconds), error=line)

    @contextmanager
    def _stage(self, item: Item, title: str) -> Iterator[Callable[[float], None]]:
        self._go_on()
        with self._telling:
            self._watcher.stage(item, title)
        yield self._go_on

    def _go_on(self, _: float = 0.0) -> None:
        if self._stop.is_set():
            raise _StoppedError


def _remove_empty(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
