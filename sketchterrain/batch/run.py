"""Runs of a batch: concurrent terrains, each written completely or not at all, resumable."""

import gc
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from threading import Event, local
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from sketchterrain.batch.plan import Item
from sketchterrain.batch.results import (
    DEFAULT_SIZE,
    MANIFEST,
    PREVIEW_MEMORY,
    BatchProgress,
    Entry,
    File,
    Manifest,
    Needs,
    Output,
    estimate_needs,
    read_manifest,
    write_sheets,
)
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.export.files import prepare_folder
from sketchterrain.export.foliage_files import FoliageOptions
from sketchterrain.export.planning import checked_plan
from sketchterrain.export.rasters import write_picture
from sketchterrain.export.target import ExportOptions
from sketchterrain.generation.stages import fingerprint
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io.console import Stages, describe_error
from sketchterrain.io.files import check_disk, hash_file
from sketchterrain.io.system import Interrupts, exclusive_run, free_memory
from sketchterrain.jobs.estimates import Estimate
from sketchterrain.jobs.export import DeviceFallback, JobResult, build_terrain, write_export
from sketchterrain.jobs.generate import (
    GenerateOptions,
    SharedResources,
    generate,
    measure_terrain,
    render_preview,
    report_header,
    rounded,
    run_statistics,
    write_together,
)
from sketchterrain.jobs.pictures import sketch_weather
from sketchterrain.render.offscreen import SnapshotRenderer
from sketchterrain.render.views import check_view

_POLL: Final = 0.2  # s between two checks for Ctrl-C
_SHARE: Final = 0.9  # of the free memory, which a batch may take


class BatchResult(NamedTuple):
    """Entries of a batch in order, names of those that were finished before, sheets, wall time (s)."""

    entries: list[Entry]
    skipped: set[str]
    sheets: list[str]
    seconds: float


class _StoppedError(Exception):
    """The batch was interrupted; unfinished terrains are discarded."""


def estimate_items(items: Sequence[Item], output: Output) -> dict[str, Needs | SketchterrainError]:
    """Return the needs of each item, or its error; raise the first error if all items fail."""
    needs: dict[str, Needs | SketchterrainError] = {}
    for item in items:
        try:
            needs[item.name] = estimate_needs(item.sketch, output)
        except SketchterrainError as error:
            needs[item.name] = error
    errors = [each for each in needs.values() if isinstance(each, SketchterrainError)]
    if len(errors) == len(needs):
        raise errors[0]
    return needs


def check_folder(folder: Path, *, resume: bool) -> None:
    """Raise InputError if a folder is a file, holds a batch without `resume`, or a broken manifest."""
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise InputError(f"{one_line(folder)}: expected a folder, {one_line(existing)} is a file")
    if read_manifest(folder) is not None and not resume:
        raise InputError(
            f"{one_line(folder)}: contains a batch ({MANIFEST}); --resume completes it, or use another folder"
        )


def finished_items(
    items: Sequence[Item], folder: Path, output: Output, progress: BatchProgress | None = None
) -> dict[str, Entry]:
    """Return the entries of an earlier run with the same input and intact files."""
    manifest = read_manifest(folder)
    found, entries = {}, {} if manifest is None else manifest.entries
    for number, item in enumerate(items):
        entry = entries.get(item.name)
        if entry is not None and entry.state == "done":
            if progress is not None:
                progress.verified(number, len(items))
            with suppress(SketchterrainError):
                if entry.input == fingerprint(item.sketch, output) and entry.is_intact(folder / item.name):
                    found[item.name] = entry
    return found


def estimate_batch(needs: Iterable[object], output: Output, jobs: int) -> tuple[int, Estimate]:
    """Return the number of concurrent terrains that fit into memory, and the needs of the batch."""
    known = [each for each in needs if isinstance(each, Needs)]
    one = max((each.memory for each in known), default=1.0)
    previews = PREVIEW_MEMORY if output.preview and known else 0
    jobs_in_memory = int((_SHARE * free_memory() - previews) // one)
    jobs = max(min(jobs, jobs_in_memory, len(known)), 1)
    memory = jobs * one + previews if known else 0.0
    return jobs, Estimate({"terrains": sum(each.disk for each in known)}, memory)


def run_batch(
    items: Sequence[Item],
    folder: Path,
    output: Output,
    *,
    device: str | None,
    jobs: int,
    resume: bool,
    progress: BatchProgress,
) -> BatchResult:
    """Write all terrains of a batch, up to `jobs` at once; a failure does not stop the others.

    Items that the manifest lists as done are complete even after a kill, and a resumed batch ends with the
    same files.
    """
    devices = DeviceFallback(device, fast=output.fast)
    needs = estimate_items(items, output)
    check_folder(folder, resume=resume)
    prepare_folder(folder)
    with exclusive_run(folder / MANIFEST):
        for partial_file in folder.glob(".*.tmp"):  # of a killed run
            partial_file.unlink(missing_ok=True)
        batch = _Batch(items, folder, output, devices, progress)
        jobs, estimate = estimate_batch((needs[item.name] for item in batch.todo), output, jobs)
        check_disk(folder, estimate.disk_needed, "files of the batch")
        return batch.run(jobs)


class _Batch:
    def __init__(
        self,
        items: Sequence[Item],
        folder: Path,
        output: Output,
        devices: DeviceFallback,
        progress: BatchProgress,
    ) -> None:
        self._folder, self._output, self._devices, self._progress = folder, output, devices, progress
        self._items, self._skipped = items, finished_items(items, folder, output, progress)
        self.todo = [item for item in items if item.name not in self._skipped]
        self._stop, self._thread, self._render = Event(), local(), None
        before = read_manifest(folder)
        earlier, self._sheets = ({}, []) if before is None else (before.entries, before.sheets)
        # Files of a changed item remain until new ones are written.
        files = {name: entry.files for name, entry in earlier.items()}
        blank = {item.name: replace(_blank(item), files=files.get(item.name, ())) for item in self.todo}
        names = (*(item.name for item in items), *earlier)
        self._entries = {name: blank.get(name) or earlier[name] for name in names}

    def run(self, jobs: int) -> BatchResult:
        self._write_manifest()
        self._progress.started(len(self.todo), len(self._skipped))
        start = time.perf_counter()
        with ExitStack() as stack:
            if self._output.preview:
                self._render = stack.enter_context(_previews(self._check_stop))
            self._write_all(jobs, stack.enter_context(Interrupts()))
        seconds = time.perf_counter() - start
        shown = [entry for entry in self._entries.values() if entry.state != "waiting"]
        sheets = write_sheets(self._folder, shown)
        for name in {*self._sheets} - {*sheets}:
            (self._folder / name).unlink(missing_ok=True)
        self._sheets = sheets
        self._write_manifest()
        entries = [self._entries[item.name] for item in self._items]
        return BatchResult(entries, {*self._skipped}, sheets, seconds)

    def _write_all(self, jobs: int, interrupts: Interrupts) -> None:
        """Write missing terrains; raise KeyboardInterrupt once all files are complete."""
        waiting, pending = iter(self.todo), set[Future[Entry]]()
        pool = ThreadPoolExecutor(jobs, "terrain", self._prepare_thread)
        try:
            while True:
                interrupts.check()
                more = islice(waiting, jobs + 1 - len(pending))  # one queued, so that no thread waits
                pending |= {pool.submit(self._write_item, item) for item in more}
                if not pending:
                    break
                finished, pending = wait(pending, _POLL, FIRST_COMPLETED)
                for future in finished:
                    self._record(future.result())
                    self._progress.finished(future.result())
                    gc.collect()  # reference cycles hold terrains, hundreds of megabytes
        finally:
            self._stop.set()
            if pending:
                self._progress.interrupted()
            pool.shutdown(cancel_futures=True)
            for future in pending:
                if not future.cancelled() and future.exception() is None:
                    self._record(future.result())

    def _prepare_thread(self) -> None:
        # With a placement cache.
        self._thread.shared = SharedResources(self._devices, take_picture=self._render)

    def _write_item(self, item: Item) -> Entry:
        folder, start, entry = self._folder / item.name, time.perf_counter(), _blank(item)
        stages = Stages(lambda title: self._stage(item, title))
        try:
            sketch = item.sketch
            entry = replace(entry, input=fingerprint(sketch, self._output))
            done = write_terrain(sketch, folder, self._output, shared=self._thread.shared, stages=stages)
            entry = replace(
                entry,
                state="done" if done.problem is None else "partial",
                files=tuple(File(path.name, *hash_file(path)) for path in done.files),
                adherence={key: each for key, each in done.report["adherence"].items() if key != "shapes"},
                realism=done.report.get("realism"),
                base=done.report.get("base"),
                notes=tuple(done.report["restarts"]),
                error=one_line(done.problem or ""),
            )
        except Exception as error:  # must not stop other items
            with suppress(OSError):
                folder.rmdir()  # unless it contains files
            if isinstance(error, _StoppedError):
                raise
            entry = replace(entry, state="failed", error=one_line(" ".join(describe_error(error)[0].split())))
        return replace(entry, seconds=round(time.perf_counter() - start, 4), timings=rounded(stages.seconds))

    @contextmanager
    def _stage(self, item: Item, title: str) -> Iterator[Callable[[float], None]]:
        self._check_stop()
        self._progress.stage(item.name, title)

        def show(share: float) -> None:
            self._check_stop()
            self._progress.share(item.name, share)

        yield show

    def _check_stop(self) -> None:
        if self._stop.is_set():
            raise _StoppedError

    def _record(self, entry: Entry) -> None:
        """Record an entry in the manifest and remove stale files of an earlier run."""
        before = self._entries[entry.name]
        if entry.state == "failed":
            entry = replace(entry, files=before.files)
        for name in {each.file for each in before.files} - {each.file for each in entry.files}:
            (self._folder / entry.name / name).unlink(missing_ok=True)
        self._entries[entry.name] = entry
        self._write_manifest()

    def _write_manifest(self) -> None:
        items = list(self._entries.values())
        Manifest(1, version("sketchterrain"), self._output, items, self._sheets).write(self._folder)


@contextmanager
def _previews(check_stop: Callable[[], None]) -> Iterator[Any]:
    """Yield a function that renders pictures on one thread with an OpenGL context."""
    renderers: list[SnapshotRenderer] = []

    def render(terrain: Terrain, request: dict[str, Any]) -> npt.NDArray[np.uint8]:
        check_stop()
        if not renderers:
            renderers.append(SnapshotRenderer())
        return renderers[0].picture(terrain, **request)

    with ThreadPoolExecutor(1, "previews") as thread:
        try:
            yield lambda terrain, **request: thread.submit(render, terrain, request).result()
        finally:
            for renderer in renderers:
                thread.submit(renderer.close).result()


def write_terrain(
    sketch: Sketch, folder: Path, output: Output, *, shared: SharedResources, stages: Stages
) -> JobResult:
    """Write a terrain's files, moved into the folder together once all are complete."""
    if output.target is not None:
        return _export(sketch, folder, output, output.target, shared, stages)
    foliage, size = FoliageOptions(output.foliage, output.grass), output.size or DEFAULT_SIZE
    options = GenerateOptions(size, foliage, output.preview, output.view, map=output.map)
    return generate(sketch, folder, options, stages=stages, shared=shared)


def _export(
    sketch: Sketch, folder: Path, output: Output, target: str, shared: SharedResources, stages: Stages
) -> JobResult:
    check_view(output.view)
    weather = sketch_weather(sketch)
    export_plan = checked_plan(sketch, target, output.options or ExportOptions())

    def write(context: ComputeContext, hidden: Path) -> JobResult:
        terrain = build_terrain(sketch, context, stages, shared.memory)
        done = write_export(export_plan, terrain, hidden, stages=stages)
        measured = measure_terrain(terrain, stages)
        files, problem, rendering = done.files, None, dict[str, float]()
        if output.preview and shared.take_picture is not None:
            with stages.stage("preview", "Preview"):
                picture, problem = render_preview(
                    terrain, output.view, weather, shared.take_picture, rendering
                )
                if picture is not None:
                    files += write_picture(hidden / "preview.png", picture)
        facts = report_header(terrain) | run_statistics(stages, rendering, files)
        return JobResult(facts | {"target": target, **measured}, files, problem)

    return write_together(folder, write, shared.devices, stages)


def _blank(item: Item) -> Entry:
    return Entry(item.name, one_line(item.source.given), item.seed, dict(item.settings))
