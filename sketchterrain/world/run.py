"""A world from begin to end: what is there is verified, what is not is made, all of it is told of."""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Protocol

from msgspec import structs

from sketchterrain.batch.interrupts import Interrupts
from sketchterrain.errors import InputError, one_line
from sketchterrain.world.alone import AloneCrew
from sketchterrain.world.begun import known, refuse_taken
from sketchterrain.world.fingerprint import fingerprint
from sketchterrain.world.forms import plants_of, store_of
from sketchterrain.world.ledger import Header, Journal, Ledger, ledger_text
from sketchterrain.world.lock import held
from sketchterrain.world.making import hashed
from sketchterrain.world.roots import Roots
from sketchterrain.world.sweeping import sweep
from sketchterrain.world.tasks import task_count, tasks_of
from sketchterrain.world.verification import Broken, lost_lines, verify

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from sketchterrain.world.begun import Known
    from sketchterrain.world.crew import Crew
    from sketchterrain.world.job import Job
    from sketchterrain.world.made import Made, Task, WrittenFile

__all__ = ["Done", "Watcher", "refuse_taken", "run_world"]


class Watcher(Protocol):
    """Is told how a world goes on, all in one thread; whatever it raises ends the run."""

    def verified(self, share: float) -> None:
        """Tell how much of what is there is verified, 0 … 1."""

    def broken(self, file: Broken) -> None:
        """Tell of a file that is missing or has other bytes; it will be made again."""

    def began(self, tasks: int, done: int) -> None:
        """Tell how many tasks there are, and how many of them are done; nothing is made yet."""

    def made(self, made: Made) -> None:
        """Tell of a task that is done."""

    def joined(self, share: float) -> None:
        """Tell how much of what joins all is written, 0 … 1."""

    def note(self, line: str) -> None:
        """Tell what happened to devices and workers."""


@dataclass(frozen=True)
class Done:
    """What came of a world.

    Attributes
    ----------
    tasks, made : int
        All tasks, and those that this run did.
    broken : tuple of Broken
        Files that were missing or had other bytes, and were made again.
    files, bytes : int
        Of the whole world.
    seconds : float
        All in all.
    """

    tasks: int
    made: int
    broken: tuple[Broken, ...]
    files: int
    bytes: int
    seconds: float


def run_world(
    job: Job,
    *,
    device: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    watcher: Watcher,
) -> Done:
    """Write a world.

    After Ctrl-C, a full disk or a kill at any moment, a run with `resume` ends with the same bytes as one
    that was never disturbed. So it does where files were deleted or changed meanwhile.

    Parameters
    ----------
    job
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`; of workers, each one's.
    workers
        So many processes of this machine do it; None: this process does.
    scheduler
        Address of a dask scheduler, whose workers do it.
    resume
        Whether what is there is gone on with.
    watcher
        Is told how it goes on.

    Raises
    ------
    InputError
        If there is something at the output and `resume` is not given, or it is another world, or another
        run is at work there.
    DeviceError
        If no device or no worker can do it.
    SketchterrainError
        If the system cannot write a file.
    """
    start = time.perf_counter()
    if job.fast and (workers is not None or scheduler is not None):
        raise InputError(
            "--fast has bits of its own on each device: leave it out, or --workers and --scheduler"
        )
    refuse_taken(job, resume=resume)
    store = store_of(job)
    with held(store.journal, job.output) as stream, Interrupts() as interrupts:
        run = _Run(job, known(job, store), watcher, interrupts)  # as whoever was at work there left it
        if not run.is_whole():
            run.prepare()
            if run.has_tasks_left:
                crew, own_bits = _crew(run, interrupts, device=device, workers=workers, scheduler=scheduler)
                run.begin(Journal(store.journal, stream), own_bits)
                with crew:
                    for made in crew.make(run.tasks_left()):
                        run.record(made)
                interrupts.check()
            run.join()
        run.close()
    return run.done(time.perf_counter() - start)


class _Run:
    """A world while it is written."""

    def __init__(self, job: Job, found: Known | None, watcher: Watcher, interrupts: Interrupts) -> None:
        self.job, self.watcher, self._found, self._interrupts = job, watcher, found, interrupts
        self._store, self._plants, self._roots = store_of(job), plants_of(job), Roots.of(job)
        header = Header(fingerprint(job), version("sketchterrain"))
        self._ledger = Ledger(header, {}) if found is None else found.ledger
        self._journal: Journal | None = None
        self._broken: list[Broken] = []
        self._undone: set[Task] = set()
        self._made = 0
        self._tasks = task_count(job)

    def is_whole(self) -> bool:
        """Tell whether the world was finished and every file of it is as it was written."""
        if self._found is None:
            return False
        for each in verify(self._ledger, self._roots, progress=self._told(self.watcher.verified)):
            self._broken.append(each)
            self.watcher.broken(each)
        if self._found.finished and (lost := lost_lines(self._ledger)) is not None:
            self._broken.append(lost)
            self.watcher.broken(lost)
        untold = self._store.keeps_shards and self.has_tasks_left
        return self._found.finished and not (self._broken or untold)

    def prepare(self) -> None:
        """Leave nothing there but what is whole, and write what depends on no ground."""
        lost = {each.file for each in self._broken}
        done = self._ledger.done
        self._undone = {task for task, files in done.items() if not lost.isdisjoint(_names(files))}
        for task in self._undone:
            del done[task]
        self._sweep()
        self._ledger.others = (*self._hashed(self._store.create()), *self._fixed_of_plants())
        self.watcher.began(self._tasks, len(done))

    @property
    def begun_on(self) -> str | None:
        """What `own_bits` says of the device that a part of it is made on; None where there is no part."""
        return self._ledger.header.device if self._ledger.done else None

    @property
    def has_tasks_left(self) -> bool:
        """Whether not all tasks are done."""
        return len(self._ledger.done) < self._tasks

    def tasks_left(self) -> Iterator[Task]:
        """Return the tasks that are not done, no more of them once Ctrl-C or SIGTERM came."""
        for task in tasks_of(self.job):
            if self._interrupts.heard:
                self.watcher.note("ends once what is begun is written; Ctrl-C again ends it at once")
                return
            if task not in self._ledger.done:
                yield task

    def begin(self, journal: Journal, own_bits: str) -> None:
        """Begin to keep a journal."""
        header = structs.replace(self._ledger.header, device=own_bits)
        goes_on = self._found is not None and not self._found.finished and header == self._ledger.header
        self._ledger.header, self._journal = header, journal
        if goes_on:
            journal.go_on(self._ledger.others)
            for task in self._undone:
                journal.add(task, ())
        else:
            journal.begin(self._ledger)

    def record(self, made: Made) -> None:
        """Keep what came of a task."""
        if self._journal is not None:
            self._journal.add(made.task, made.files)
        self._ledger.done[made.task] = made.files
        self._made += 1
        self.watcher.made(made)

    def join(self) -> None:
        """Write what joins all shards, and keep in the ledger what stays."""
        if self._journal is not None:
            self._journal.sync()
        self._sweep()  # what lost workers have left
        joined = self._hashed(self._store.join(progress=self._told(self.watcher.joined)))
        if self._store.keeps_shards:
            self._ledger.others += joined
        else:
            self._ledger.others = (*joined, *self._fixed_of_plants())
            done = self._ledger.done
            self._ledger.done = {task: files for task, files in done.items() if task.kind != "ground"}

    def close(self) -> None:
        """Write the ledger; then the world is whole."""
        self._store.close(ledger_text(self._ledger))

    def done(self, seconds: float) -> Done:
        """Return what came of it."""
        files = list(self._ledger.files)
        size = sum(file.bytes for file in files)
        return Done(self._tasks, self._made, tuple(self._broken), len(files), size, seconds)

    def _told(self, tell: Callable[[float], None]) -> Callable[[float], None]:
        """Return what takes the share that is done of work that Ctrl-C ends at once."""

        def told(share: float) -> None:
            self._interrupts.check()
            tell(share)

        return told

    def _sweep(self) -> None:
        sweep(self.job, self._store, self._roots, {*_names(self._ledger.files)})

    def _fixed_of_plants(self) -> tuple[WrittenFile, ...]:
        if self._plants is None:
            return ()
        return self._hashed(self._roots.named_plants(self._plants.create()))

    def _hashed(self, names: Iterable[str]) -> tuple[WrittenFile, ...]:
        return tuple(hashed(self._roots.path(name), name) for name in names)


def _crew(
    run: _Run, interrupts: Interrupts, *, device: str | None, workers: int | None, scheduler: str | None
) -> tuple[Crew, str]:
    """Return who does the tasks, and what names their bits where not every device has them."""
    job, note = run.job, run.watcher.note
    if workers is None and scheduler is None:
        alone = AloneCrew(job, device=device, note=note, begun_on=run.begun_on)
        return alone, alone.own_bits
    if run.begun_on:
        raise InputError(f"{one_line(job.output)}: was begun on {run.begun_on}, and workers have other bits")
    from sketchterrain.world.cluster import ClusterCrew

    crew = ClusterCrew(
        job,
        workers=workers,
        scheduler=scheduler,
        device=device,
        note=note,
        stopped=lambda: interrupts.heard,
    )
    return crew, ""


def _names(files: Iterable[WrittenFile]) -> Iterator[str]:
    return (file.file for file in files)
