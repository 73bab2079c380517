"""A world written from begin to end: existing shards are verified, missing ones computed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from itertools import chain

from msgspec import structs

from sketchterrain.batch.interrupts import Interrupts
from sketchterrain.errors import InputError, one_line
from sketchterrain.world.cluster import ClusterExecutor
from sketchterrain.world.fingerprint import fingerprint
from sketchterrain.world.job import Job
from sketchterrain.world.journal import Header, Journal, Ledger, OutputLayout, exclusive_run
from sketchterrain.world.progress import ProgressReporter
from sketchterrain.world.resume import (
    Broken,
    SavedState,
    broken_lines,
    check_output_unused,
    load_state,
    remove_partial_files,
    verify,
)
from sketchterrain.world.serial import SerialExecutor
from sketchterrain.world.store import store_of
from sketchterrain.world.task_runner import file_record
from sketchterrain.world.tasks import Task, WrittenFile, task_count, tasks_of

Executor = SerialExecutor | ClusterExecutor


@dataclass(frozen=True)
class WorldResult:
    """Outcome of a run: tasks, those of this run, broken files it mended; files and bytes of the world."""

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
    watcher: ProgressReporter,
) -> WorldResult:
    """Write a world.

    After Ctrl-C, a full disk or a kill at any moment, a run with `resume` ends with the same bytes as one
    that was never disturbed. So it does where files were deleted or changed meanwhile.

    Parameters
    ----------
    job
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`; of workers, each one's.
    workers
        Number of worker processes on this machine; None: this process does all.
    scheduler
        Address of a dask scheduler, whose workers do it.
    resume
        Resume an existing run.
    watcher
        Receives the progress, in this thread; whatever it raises ends the run.

    Raises
    ------
    InputError
        If there is something at the output and `resume` is not given, or it is another world, or another
        run is writing it.
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
    check_output_unused(job, resume=resume)
    with exclusive_run(job.output), Interrupts() as interrupts:
        run = _Run(job, load_state(job, store_of(job)), watcher, interrupts)
        if not run.is_finished():
            run.prepare()
            if run.has_tasks_left:
                run.run_tasks(device=device, workers=workers, scheduler=scheduler)
                interrupts.check()
            run.join()
        run.close()
    return run.result(time.perf_counter() - start)


class _Run:
    """The state of a run."""

    def __init__(
        self, job: Job, state: SavedState | None, watcher: ProgressReporter, interrupts: Interrupts
    ) -> None:
        self.job, self.watcher, self._interrupts = job, watcher, interrupts
        self._store, self._layout = store_of(job), OutputLayout.of(job)
        header = Header(fingerprint(job), version("sketchterrain"))
        self._ledger = Ledger(header, {}) if state is None else state.ledger
        self._was_finished = state is not None and state.finished
        self._broken: list[Broken] = []
        self._made = 0
        self._tasks = task_count(job)

    def is_finished(self) -> bool:
        """Verify all files; return whether the world is finished and none of them is broken."""
        found = verify(self._ledger, self._layout, progress=self._interruptible(self.watcher.verified))
        for each in chain(found, broken_lines(self._ledger) if self._was_finished else ()):
            self._broken.append(each)
            self.watcher.broken(each)
        lost = self._store.keeps_shards and self.has_tasks_left
        return self._was_finished and not (self._broken or lost)

    def prepare(self) -> None:
        """Remove what is not whole, and write what depends on no ground."""
        broken, done = {each.file for each in self._broken}, self._ledger.done
        for task in [each for each in done if not broken.isdisjoint(file.file for file in done[each])]:
            del done[task]
        self._remove_partial_files()
        self._ledger.others = self._records(self._store.create())
        self.watcher.began(self._tasks, len(done))

    @property
    def has_tasks_left(self) -> bool:
        """Whether not all tasks are done."""
        return len(self._ledger.done) < self._tasks

    def run_tasks(self, *, device: str | None, workers: int | None, scheduler: str | None) -> None:
        """Run the tasks that are not done, and write them into the journal."""
        executor = self._executor(device=device, workers=workers, scheduler=scheduler)
        with Journal(self._store.journal, self._ledger) as journal, executor:
            for result in executor.run(self._tasks_left()):
                journal.add(result.task, result.files)
                self._ledger.done[result.task] = result.files
                self._made += 1
                self.watcher.made(result)
            journal.sync()

    def join(self) -> None:
        """Write what joins all shards, and keep in the ledger what stays."""
        self._remove_partial_files()  # of lost workers
        joined = self._records(self._store.join(progress=self._interruptible(self.watcher.joined)))
        if self._store.keeps_shards:
            self._ledger.others += joined
        else:
            self._ledger.others = joined
            done = self._ledger.done
            self._ledger.done = {task: files for task, files in done.items() if task.kind != "ground"}

    def close(self) -> None:
        """Write the ledger; then the world is finished."""
        self._store.journal.parent.mkdir(parents=True, exist_ok=True)  # `close` deletes what is in it
        self._store.close(self._ledger.text())

    def result(self, seconds: float) -> WorldResult:
        """Return the outcome."""
        files = list(self._ledger.files)
        size = sum(file.bytes for file in files)
        return WorldResult(self._tasks, self._made, tuple(self._broken), len(files), size, seconds)

    def _executor(self, *, device: str | None, workers: int | None, scheduler: str | None) -> Executor:
        """Return who runs the tasks; the ledger's header then names a device whose bits are its own."""
        header, note = self._ledger.header, self.watcher.note
        begun_on = header.device if self._ledger.done else None
        if workers is None and scheduler is None:
            serial = SerialExecutor(self.job, device=device, note=note, begun_on=begun_on)
            self._ledger.header = structs.replace(header, device=serial.own_bits)
            return serial
        if begun_on:
            raise InputError(
                f"{one_line(self.job.output)}: was begun on {begun_on}, and workers have other bits"
            )
        self._ledger.header = structs.replace(header, device="")
        return ClusterExecutor(
            self.job,
            workers=workers,
            scheduler=scheduler,
            device=device,
            note=note,
            stopped=lambda: self._interrupts.heard,
        )

    def _tasks_left(self) -> Iterator[Task]:
        """Yield the tasks that are not done, until Ctrl-C or SIGTERM."""
        for task in tasks_of(self.job):
            if self._interrupts.heard:
                self.watcher.note("ends once the current shards are written; Ctrl-C again ends it at once")
                return
            if task not in self._ledger.done:
                yield task

    def _interruptible(self, report: Callable[[float], None]) -> Callable[[float], None]:
        """Return a progress callback that Ctrl-C ends at once."""

        def reported(share: float) -> None:
            self._interrupts.check()
            report(share)

        return reported

    def _remove_partial_files(self) -> None:
        whole = {file.file for file in self._ledger.files}
        remove_partial_files(self.job, self._store, self._layout, whole)

    def _records(self, names: Iterable[str]) -> tuple[WrittenFile, ...]:
        return tuple(file_record(self._layout.path(name), name) for name in names)
