"""A batch: terrains made several at once, each whole or not there, and resumed after a stop."""

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

from sketchterrain.app.console import Stages, describe_error
from sketchterrain.app.estimates import Estimate, free_memory
from sketchterrain.app.export import write_export
from sketchterrain.app.generate import (
    REPORT,
    GenerateOptions,
    GenerateResult,
    SharedResources,
    generate,
    render_preview,
    report_header,
    rounded,
    run_statistics,
    stale_report_files,
)
from sketchterrain.app.jobs import DeviceFallback
from sketchterrain.app.pictures import sketch_weather
from sketchterrain.batch.plan import Item
from sketchterrain.batch.results import (
    DEFAULT_SIZE,
    MANIFEST,
    PREVIEW_MEMORY,
    BatchProgress,
    Entry,
    Manifest,
    Needs,
    Output,
    fingerprint,
    hashed,
    needs_of,
    read_manifest,
    write_sheets,
)
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.export.files import move_files, prepare_folder, staging, write_json
from sketchterrain.export.foliage_files import FoliageOptions
from sketchterrain.export.planning import checked_plan
from sketchterrain.export.rasters import write_picture
from sketchterrain.export.target import ExportOptions
from sketchterrain.io.files import check_disk
from sketchterrain.io.system import Interrupts
from sketchterrain.render.offscreen import SnapshotRenderer
from sketchterrain.render.views import check_view
from sketchterrain.terrain.adherence import measure_adherence
from sketchterrain.terrain.building import build
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.world.journal import exclusive_run

_POLL: Final = 0.2  # s between two checks for Ctrl-C
_SHARE: Final = 0.9  # of the free memory, which a batch may take


class Done(NamedTuple):
    """The entries of a batch in order, names of those that were whole before, sheets, and wall time."""

    entries: list[Entry]
    skipped: set[str]
    sheets: list[str]
    seconds: float


class _StoppedError(Exception):
    """The batch ends; terrains in work are given up."""


def items_needs(items: Sequence[Item], output: Output) -> dict[str, Needs | SketchterrainError]:
    """Return what each item needs, or why it cannot be made; raise the first error if none can."""
    needs: dict[str, Needs | SketchterrainError] = {}
    for item in items:
        try:
            needs[item.name] = needs_of(item.sketch, output)
        except SketchterrainError as error:
            needs[item.name] = error
    errors = [each for each in needs.values() if isinstance(each, SketchterrainError)]
    if len(errors) == len(needs):
        raise errors[0]
    return needs


def check_folder(folder: Path, *, resume: bool) -> None:
    """Raise InputError if a folder is a file, or holds a batch without `resume`, or a broken manifest."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise InputError(f"{one_line(folder)}: expected a folder, {one_line(there)} is a file")
    if read_manifest(folder) is not None and not resume:
        raise InputError(
            f"{one_line(folder)}: there is a batch in it ({MANIFEST}); --resume goes on with it, "
            "or take another folder"
        )


def whole_items(
    items: Sequence[Item], folder: Path, output: Output, progress: BatchProgress | None = None
) -> dict[str, Entry]:
    """Return the entries of an earlier run that have the same input, and whose files have their hashes."""
    manifest = read_manifest(folder)
    found, entries = {}, {} if manifest is None else manifest.entries
    for number, item in enumerate(items):
        entry = entries.get(item.name)
        if entry is not None and entry.state == "done":
            if progress is not None:
                progress.verified(number, len(items))
            with suppress(SketchterrainError):
                if entry.input == fingerprint(item.sketch, output) and entry.whole(folder / item.name):
                    found[item.name] = entry
    return found


def estimate_batch(needs: Iterable[object], output: Output, jobs: int) -> tuple[int, Estimate]:
    """Return how many terrains can be in work at once, by the free memory, and what the batch takes."""
    known = [each for each in needs if isinstance(each, Needs)]
    one = max((each.memory for each in known), default=1.0)
    previews = PREVIEW_MEMORY if output.preview and known else 0
    fitting = int((_SHARE * free_memory() - previews) // one)
    jobs = max(min(jobs, fitting, len(known)), 1)
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
) -> Done:
    """Make all terrains of a batch, so many at once where there is memory for them.

    A terrain that fails stops no other one. After Ctrl-C, and after a kill at any moment, what the manifest
    calls done is whole, and a batch that is resumed ends with the same files.
    """
    devices = DeviceFallback(device, fast=output.fast)
    needs = items_needs(items, output)
    check_folder(folder, resume=resume)
    prepare_folder(folder)
    with exclusive_run(folder / MANIFEST):
        for partial_file in folder.glob(".*.tmp"):  # of a batch that was killed
            partial_file.unlink(missing_ok=True)
        batch = _Batch(items, folder, output, devices, progress)
        jobs, estimate = estimate_batch((needs[item.name] for item in batch.todo), output, jobs)
        check_disk(folder, estimate.disk_needed, "files of the batch")
        return batch.run(jobs)


class _Batch:
    """A batch while it runs."""

    def __init__(
        self,
        items: Sequence[Item],
        folder: Path,
        output: Output,
        devices: DeviceFallback,
        progress: BatchProgress,
    ) -> None:
        self._folder, self._output, self._devices, self._progress = folder, output, devices, progress
        self._items, self._skipped = items, whole_items(items, folder, output, progress)
        self.todo = [item for item in items if item.name not in self._skipped]
        self._stop, self._thread, self._render = Event(), local(), None
        before = read_manifest(folder)
        earlier, self._sheets = ({}, []) if before is None else (before.entries, before.sheets)
        # Files of an item that changed stay until there are others.
        files = {name: entry.files for name, entry in earlier.items()}
        blank = {item.name: replace(_blank(item), files=files.get(item.name, ())) for item in self.todo}
        names = (*(item.name for item in items), *earlier)
        self._entries = {name: blank.get(name) or earlier[name] for name in names}

    def run(self, jobs: int) -> Done:
        """Make what is not there, then the contact sheets."""
        self._write_manifest()
        self._progress.begins(len(self.todo), len(self._skipped))
        start = time.perf_counter()
        with ExitStack() as stack:
            if self._output.preview:
                self._render = stack.enter_context(_previews(self._go_on))
            self._make_all(jobs, stack.enter_context(Interrupts()))
        seconds = time.perf_counter() - start
        shown = [entry for entry in self._entries.values() if entry.state != "waiting"]
        sheets = write_sheets(self._folder, shown)
        for name in {*self._sheets} - {*sheets}:
            (self._folder / name).unlink(missing_ok=True)
        self._sheets = sheets
        self._write_manifest()
        entries = [self._entries[item.name] for item in self._items]
        return Done(entries, {*self._skipped}, sheets, seconds)

    def _make_all(self, jobs: int, interrupts: Interrupts) -> None:
        """Make what is not there; Ctrl-C is raised when nothing is half-written."""
        waiting, pending = iter(self.todo), set[Future[Entry]]()
        pool = ThreadPoolExecutor(jobs, "terrain", self._prepare_thread)
        try:
            while True:
                interrupts.check()
                more = islice(waiting, jobs + 1 - len(pending))  # one waits, so that no thread does
                pending |= {pool.submit(self._make, item) for item in more}
                if not pending:
                    break
                finished, pending = wait(pending, _POLL, FIRST_COMPLETED)
                for future in finished:
                    self._record(future.result())
                    self._progress.finished(future.result())
                    gc.collect()  # terrains hold themselves in cycles, which take hundreds of megabytes
        finally:
            self._stop.set()
            if pending:
                self._progress.stops()
            pool.shutdown(cancel_futures=True)
            for future in pending:
                if not future.cancelled() and future.exception() is None:
                    self._record(future.result())

    def _prepare_thread(self) -> None:
        self._thread.shared = SharedResources(
            self._devices, take_picture=self._render
        )  # with a cache of placements

    def _make(self, item: Item) -> Entry:
        """Make an item; its entry tells the error if it failed."""
        folder, start, entry = self._folder / item.name, time.perf_counter(), _blank(item)
        stages = Stages(lambda title: self._stage(item, title))
        try:
            sketch = item.sketch
            entry = replace(entry, input=fingerprint(sketch, self._output))
            done = make(sketch, folder, self._output, shared=self._thread.shared, stages=stages)
            entry = replace(
                entry,
                state="done" if done.problem is None else "partial",
                files=tuple(hashed(path) for path in done.files),
                adherence={key: each for key, each in done.report["adherence"].items() if key != "shapes"},
                notes=tuple(done.report["restarts"]),
                error=one_line(done.problem or ""),
            )
        except Exception as error:  # whatever it is, it stops no other item
            with suppress(OSError):
                folder.rmdir()  # which leaves a folder with files
            if isinstance(error, _StoppedError):
                raise
            entry = replace(entry, state="failed", error=one_line(" ".join(describe_error(error)[0].split())))
        return replace(entry, seconds=round(time.perf_counter() - start, 4), timings=rounded(stages.seconds))

    @contextmanager
    def _stage(self, item: Item, title: str) -> Iterator[Callable[[float], None]]:
        self._go_on()
        self._progress.stage(item.name, title)
        yield self._go_on

    def _go_on(self, _: float = 0.0) -> None:
        if self._stop.is_set():
            raise _StoppedError

    def _record(self, entry: Entry) -> None:
        """Write an entry into the manifest, and remove the stale files of an earlier run."""
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
def _previews(go_on: Callable[[], None]) -> Iterator[Any]:
    """Yield what renders pictures on one thread, which keeps OpenGL open; `go_on` is called before each."""
    studios: list[SnapshotRenderer] = []

    def render(terrain: Terrain, request: dict[str, Any]) -> npt.NDArray[np.uint8]:
        go_on()
        if not studios:
            studios.append(SnapshotRenderer())
        return studios[0].picture(terrain, **request)

    with ThreadPoolExecutor(1, "previews") as thread:
        try:
            yield lambda terrain, **request: thread.submit(render, terrain, request).result()
        finally:
            for studio in studios:
                thread.submit(studio.close).result()


def make(
    sketch: Sketch, folder: Path, output: Output, *, shared: SharedResources, stages: Stages
) -> GenerateResult:
    """Write a terrain's files; they come into the folder together, when all of them are there."""
    if output.target is not None:
        return _export(sketch, folder, output, output.target, shared, stages)
    foliage, size = FoliageOptions(output.foliage, output.grass), output.size or DEFAULT_SIZE
    options = GenerateOptions(size, foliage, output.preview, output.view, map=output.map)
    return generate(sketch, folder, options, stages=stages, shared=shared)


def _export(
    sketch: Sketch, folder: Path, output: Output, target: str, shared: SharedResources, stages: Stages
) -> GenerateResult:
    check_view(output.view)
    weather = sketch_weather(sketch, None, None)
    wanted = checked_plan(sketch, target, output.options or ExportOptions())

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> GenerateResult:
        prepare_folder(folder)
        with staging(folder) as hidden:
            with stages.stage("features", "Placing features"):
                terrain = build(sketch, device=context, memory=shared.memory)
            done = write_export(wanted, terrain, hidden, stages=stages)
            with stages.stage("adherence", "Comparing with the sketch"):
                adherence = measure_adherence(terrain)
            files, problem, rendering = list(done.files), None, dict[str, float]()
            if output.preview:
                with stages.stage("preview", "Preview"):
                    picture, problem = render_preview(terrain, output.view, weather, shared, rendering)
                    if picture is not None:
                        files += write_picture(hidden / "preview.png", picture)
            facts = report_header(terrain) | run_statistics(stages, rendering, files)
            facts |= {"target": target, "adherence": adherence.as_dict(), "restarts": list(restarts)}
            report = write_json(hidden / REPORT, facts)
            outdated = stale_report_files(folder, facts)
            return GenerateResult(facts, move_files(folder, (*files, report), stale=outdated), problem)

    return shared.devices.run(work, stages=stages)


def _blank(item: Item) -> Entry:
    return Entry(item.name, item.source.given, item.seed, dict(item.settings))
