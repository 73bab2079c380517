"""Runs that write or resume a world, and their progress."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from itertools import chain
from typing import TYPE_CHECKING, Final

from msgspec import structs

from sketchterrain.errors import InputError, one_line
from sketchterrain.io.console import progress_bars
from sketchterrain.io.system import Interrupts, exclusive_run
from sketchterrain.jobs.estimates import time_left
from sketchterrain.world.job import (
    Job,
    Task,
    TaskResult,
    WrittenFile,
    iter_tasks,
    job_fingerprint,
    require,
    task_count,
)
from sketchterrain.world.journal import (
    BrokenFile,
    Header,
    Journal,
    Ledger,
    broken_lines,
    check_output_unused,
    load_ledger,
    remove_partial_files,
    verify,
)
from sketchterrain.world.task_runner import SerialExecutor, shard_store

if TYPE_CHECKING:  # it loads dask, of the extra `world`
    from sketchterrain.world.cluster import ClusterExecutor

_INTERVAL: Final = 10.0  # s between two lines without a terminal
_MAX_NAMED: Final = 10  # broken files; --json lists all


class ProgressReporter:
    """Progress of a run, by default on stderr; a context manager.

    `show` receives the activity, the share done and the remaining time as text; `echo` a permanent line.
    """

    def __init__(
        self,
        *,
        show: Callable[[str, float, str], None] | None = None,
        echo: Callable[[str], None] | None = None,
        timer: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._timer = timer
        self._bar = progress_bars()
        self._bar.disable = self._bar.disable or show is not None
        self._row = self._bar.add_task("", total=1.0)
        self._show, self._echo = show or self._show_on_stderr, echo or self._bar.console.print
        self._shown_at = self._start = timer()
        self._tasks = self._done = self._present = self._broken = 0

    def __enter__(self) -> ProgressReporter:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def verified(self, share: float) -> None:
        """Show the share of existing files that is verified."""
        self._show("Verifying", share, "")

    def broken(self, file: BrokenFile) -> None:
        """Report a missing or changed file, up to a maximum number."""
        self._broken += 1
        if self._broken <= _MAX_NAMED:
            self._echo(f"{one_line(file.file)} {file.reason}: will be rewritten")

    def started(self, tasks: int, done: int) -> None:
        """Report how many of all tasks are done before the first one is run."""
        if self._broken > _MAX_NAMED:
            self._echo(f"and {self._broken - _MAX_NAMED} more files will be rewritten")
        if done:
            self._echo(f"{done} of {tasks} shards are done and verified")
        self._tasks, self._done, self._present, self._start = tasks, done, done, self._timer()
        self._bar.reset(self._row, total=tasks, completed=done)

    def task_finished(self, result: TaskResult) -> None:
        """Show the number of finished tasks and the remaining time."""
        self._done += 1
        share = (self._done - self._present) / (self._tasks - self._present)
        left = time_left(share, self._timer() - self._start)
        self._show(f"{self._done} of {self._tasks} shards", self._done / self._tasks, left)

    def joined(self, share: float) -> None:
        """Show the share of the joined files that is written."""
        self._show("Joining", share, "")

    def note(self, line: str) -> None:
        """Report an event of a device or worker."""
        self._echo(f"sketchterrain: note: {one_line(line)}")

    def _show_on_stderr(self, text: str, share: float, left: str) -> None:
        if not self._bar.disable:
            total = self._bar.tasks[0].total or 1.0
            self._bar.update(self._row, description=text, completed=share * total)
        elif self._timer() - self._shown_at >= _INTERVAL:
            self._shown_at = self._timer()
            self._echo(f"{text}: {share:.0%}{left and ', '}{left}")


@dataclass(frozen=True)
class WorldResult:
    """Outcome of a run: tasks, tasks run, files found broken; files and bytes of the world."""

    tasks: int
    computed: int
    broken: tuple[BrokenFile, ...]
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
    reporter: ProgressReporter,
) -> WorldResult:
    """Write a world in this process, by local worker processes, or by those of a dask scheduler.

    After an interrupt, a full disk, a kill, or changes to its files, a run with `resume` ends with the same
    bytes as an undisturbed one. An exception of `reporter` ends the run. Raise InputError for an output in
    use, DeviceError without a usable device or worker, SketchterrainError if a file cannot be written.
    """
    start = time.perf_counter()
    if job.fast and (workers is not None or scheduler is not None):
        raise InputError("--fast results differ between devices: omit it, or --workers and --scheduler")
    check_output_unused(job, resume=resume)
    with exclusive_run(job.output), Interrupts() as interrupts:
        run = _Run(job, reporter, interrupts)
        if not run.is_finished():
            run.prepare()
            if run.has_pending_tasks:
                run.run_tasks(run.executor(device=device, workers=workers, scheduler=scheduler))
                interrupts.check()
            run.join()
        return run.close(start)


class _Run:
    def __init__(self, job: Job, reporter: ProgressReporter, interrupts: Interrupts) -> None:
        self.job, self.reporter, self._interrupts = job, reporter, interrupts
        self._store, self._layout = shard_store(job), job.layout
        saved = load_ledger(job)
        self._ledger = saved or Ledger(Header(job_fingerprint(job), version("sketchterrain")), {})
        self._broken: list[BrokenFile] = []
        self._computed = 0
        self._tasks = task_count(job)

    def is_finished(self) -> bool:
        found = verify(self._ledger, self._layout, progress=self._interruptible(self.reporter.verified))
        for each in chain(found, broken_lines(self._ledger) if self._ledger.finished else ()):
            self._broken.append(each)
            self.reporter.broken(each)
        incomplete = self._store.shards_are_final and self.has_pending_tasks
        return self._ledger.finished and not (self._broken or incomplete)

    def prepare(self) -> None:
        """Remove partial files, and write the journal and everything that does not depend on shards."""
        broken, done = {each.file for each in self._broken}, self._ledger.done
        for task in [each for each in done if not broken.isdisjoint(file.file for file in done[each])]:
            del done[task]
        with Journal(self._layout.journal, self._ledger):  # first: it marks the output as a world
            remove_partial_files(self.job)
        self._ledger.others = self._records(self._store.create())
        self.reporter.started(self._tasks, len(done))

    @property
    def has_pending_tasks(self) -> bool:
        return len(self._ledger.done) < self._tasks

    def run_tasks(self, executor: SerialExecutor | ClusterExecutor) -> None:
        with Journal(self._layout.journal, self._ledger) as journal, executor:
            for result in executor.run(self._pending_tasks()):
                journal.add(result.task, result.files)
                self._ledger.done[result.task] = result.files
                self._computed += 1
                self.reporter.task_finished(result)

    def join(self) -> None:
        remove_partial_files(self.job)  # of lost workers
        joined = self._records(self._store.join(progress=self._interruptible(self.reporter.joined)))
        if self._store.shards_are_final:
            self._ledger.others += joined
        else:
            self._ledger.others = joined
            done = self._ledger.done
            self._ledger.done = {task: files for task, files in done.items() if task.kind != "ground"}

    def close(self, start: float) -> WorldResult:
        """Write the ledger, which marks the world as finished, and return the outcome."""
        self._layout.journal.parent.mkdir(parents=True, exist_ok=True)  # `close` deletes its content
        self._store.close(self._ledger.text())
        files, size, seconds = len(list(self._ledger.files)), self._ledger.bytes, time.perf_counter() - start
        return WorldResult(self._tasks, self._computed, tuple(self._broken), files, size, seconds)

    def executor(
        self, *, device: str | None, workers: int | None, scheduler: str | None
    ) -> SerialExecutor | ClusterExecutor:
        """Return the executor of tasks; record a device with deviating results in the ledger's header."""
        header, note = self._ledger.header, self.reporter.note
        written_on = header.device if self._ledger.done else None
        if workers is None and scheduler is None:
            serial = SerialExecutor(self.job, device=device, note=note, written_on=written_on)
            self._ledger.header = structs.replace(header, device=serial.deviating_device)
            return serial
        if written_on:
            raise InputError(
                f"{one_line(self.job.output)}: was started on {written_on}: the results of workers differ"
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
            should_stop=lambda: self._interrupts.pending,
        )

    def _pending_tasks(self) -> Iterator[Task]:
        """Yield the tasks that are not done, until Ctrl-C or SIGTERM."""
        for task in iter_tasks(self.job):
            if self._interrupts.pending:
                self.reporter.note("stopping after the current shards; press Ctrl-C again to stop at once")
                return
            if task not in self._ledger.done:
                yield task

    def _interruptible(self, report: Callable[[float], None]) -> Callable[[float], None]:

        def report_or_raise(share: float) -> None:
            self._interrupts.check()
            report(share)

        return report_or_raise

    def _records(self, names: Iterable[str]) -> tuple[WrittenFile, ...]:
        return tuple(WrittenFile.from_path(self._layout.path(name), name) for name in names)
