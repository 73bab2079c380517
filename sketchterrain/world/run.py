"""A world written from begin to end: existing shards are verified, missing ones computed; its progress."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from itertools import chain
from typing import TYPE_CHECKING, Final

from msgspec import structs
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sketchterrain.app.estimates import format_duration
from sketchterrain.errors import InputError, one_line
from sketchterrain.io.system import Interrupts
from sketchterrain.world.job import Job, Task, TaskResult, WrittenFile, fingerprint, task_count, tasks_of
from sketchterrain.world.journal import (
    Broken,
    Header,
    Journal,
    Ledger,
    OutputLayout,
    broken_lines,
    check_output_unused,
    exclusive_run,
    file_record,
    load_ledger,
    remove_partial_files,
    verify,
)
from sketchterrain.world.store import require, store_of
from sketchterrain.world.task_runner import SerialExecutor

if TYPE_CHECKING:  # it loads dask, of the extra `world`
    from sketchterrain.world.cluster import ClusterExecutor

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
            f"about {format_duration(seconds)} left" if left else "",
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
        Selector as for :func:`~sketchterrain.compute.device.choose_device`; of workers, each one's.
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
        run = _Run(job, load_ledger(job, store_of(job)), watcher, interrupts)
        if not run.is_finished():
            run.prepare()
            if run.has_tasks_left:
                run.run_tasks(device=device, workers=workers, scheduler=scheduler)
                interrupts.check()
            run.join()
        return run.close(start)


class _Run:
    """The state of a run."""

    def __init__(
        self, job: Job, saved: Ledger | None, watcher: ProgressReporter, interrupts: Interrupts
    ) -> None:
        self.job, self.watcher, self._interrupts = job, watcher, interrupts
        self._store, self._layout = store_of(job), OutputLayout.of(job)
        self._ledger = saved or Ledger(Header(fingerprint(job), version("sketchterrain")), {})
        self._broken: list[Broken] = []
        self._made = 0
        self._tasks = task_count(job)

    def is_finished(self) -> bool:
        """Verify all files; return whether the world is finished and none of them is broken."""
        found = verify(self._ledger, self._layout, progress=self._interruptible(self.watcher.verified))
        for each in chain(found, broken_lines(self._ledger) if self._ledger.finished else ()):
            self._broken.append(each)
            self.watcher.broken(each)
        lost = self._store.keeps_shards and self.has_tasks_left
        return self._ledger.finished and not (self._broken or lost)

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

    def close(self, start: float) -> WorldResult:
        """Write the ledger; then the world is finished. Return the outcome."""
        self._store.journal.parent.mkdir(parents=True, exist_ok=True)  # `close` deletes what is in it
        self._store.close(self._ledger.text())
        files, size, seconds = len(list(self._ledger.files)), self._ledger.bytes, time.perf_counter() - start
        return WorldResult(self._tasks, self._made, tuple(self._broken), files, size, seconds)

    def _executor(
        self, *, device: str | None, workers: int | None, scheduler: str | None
    ) -> SerialExecutor | ClusterExecutor:
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
        require("more than one process", ["distributed"])
        from sketchterrain.world.cluster import ClusterExecutor

        return ClusterExecutor(
            self.job,
            workers=workers,
            scheduler=scheduler,
            device=device,
            note=note,
            stopped=lambda: self._interrupts.pending,
        )

    def _tasks_left(self) -> Iterator[Task]:
        """Yield the tasks that are not done, until Ctrl-C or SIGTERM."""
        for task in tasks_of(self.job):
            if self._interrupts.pending:
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
