"""A batch: terrains made several at once, each whole or not there, and gone on with after a stop."""

from __future__ import annotations

import gc
import os
import shutil
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec

from sketchterrain.batch.crew import Crew
from sketchterrain.batch.interrupts import Interrupts
from sketchterrain.batch.manifest import MANIFEST, Entry, Manifest, read_manifest
from sketchterrain.batch.output import Fingerprints
from sketchterrain.batch.previews import Previews
from sketchterrain.batch.sheet import sheets
from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.export import prepare_folder
from sketchterrain.jobs import Devices
from sketchterrain.system import lock_folder, unlock_folder
from sketchterrain.whole_files import telling_failure

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from sketchterrain.batch.crew import Result, Watcher
    from sketchterrain.batch.output import Output
    from sketchterrain.batch.plan import Item

__all__ = ["Done", "refuse_other", "run_batch", "usual_jobs"]

_LEFTOVERS = (".sketchterrain-*", ".*.tmp")  # of export.files.staging and of whole_files, after a kill


@dataclass(frozen=True)
class Done:
    """What came of a batch.

    Attributes
    ----------
    manifest : Manifest
    made, skipped, partial, failed : tuple of Entry
        In the batch's order: whole now; whole before; without their preview; not there.
    seconds : float
        From the first terrain's begin to the last one's end.
    """

    manifest: Manifest
    made: tuple[Entry, ...]
    skipped: tuple[Entry, ...]
    partial: tuple[Entry, ...]
    failed: tuple[Entry, ...]
    seconds: float


def usual_jobs() -> int:
    """Return how many terrains are best in work at once on this machine."""
    return 2 if (os.cpu_count() or 1) > 1 else 1


def run_batch(
    items: Sequence[Item],
    folder: Path,
    output: Output,
    *,
    device: str | None,
    jobs: int,
    resume: bool,
    watcher: Watcher,
) -> Done:
    """Make all terrains of a batch.

    A terrain that fails stops no other one. After Ctrl-C, and after a kill at any moment, what the manifest
    calls done is whole, and a batch that is resumed ends with the same files.

    Parameters
    ----------
    items
        From `plan`.
    folder
        Of the batch; made if it is not there.
    output
        What is written of each terrain.
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`.
    jobs
        How many terrains are in work at once, where there is memory for them.
    resume
        Whether what is whole and unchanged is left as it is.
    watcher
        Is told how it goes on.

    Raises
    ------
    InputError
        If the folder holds a batch and `resume` is not given, its manifest is broken, another batch is at
        work there, or it is a file.
    DeviceError
        If there is no such device.
    SketchterrainError
        If the folder or the manifest cannot be written.
    """
    devices = Devices(device, fast=output.fast)
    refuse_other(folder, resume=resume)
    prepare_folder(folder)
    with _alone(folder):
        before = read_manifest(folder)  # as whoever was at work there left it
        if before is not None:
            _sweep(before)
        batch = _Batch(items, folder, output, before, watcher)
        batch.check()
        batch.manifest.write()
        start = time.perf_counter()
        batch.work(devices, jobs)
        seconds = time.perf_counter() - start
        batch.add_sheets()
        return batch.done(seconds)


class _Batch:
    """A batch while it runs."""

    def __init__(
        self, items: Sequence[Item], folder: Path, output: Output, before: Manifest | None, watcher: Watcher
    ) -> None:
        self._items, self._folder, self._output, self._watcher = items, folder, output, watcher
        self._before = {} if before is None else before.entries
        self._fingerprints = Fingerprints(output)
        self._todo: list[Item] = []
        named = {item.name for item in items}
        entries = {item.name: _blank(item) for item in items}
        entries |= {name: entry for name, entry in self._before.items() if name not in named}
        self.manifest = Manifest(folder, output.as_dict(), entries, [] if before is None else before.sheets)

    def check(self) -> None:
        """Find out what is whole and unchanged."""
        for number, item in enumerate(self._items):
            entry = self._before.get(item.name)
            if entry is None:
                self._todo.append(item)
                continue
            self._watcher.checking(number, len(self._items))
            if entry.input == self._input(item) and entry.whole(self._folder / item.name):
                self.manifest.entries[item.name] = entry
            else:  # its files stay until there are others
                self.manifest.entries[item.name] = _blank(item, entry)
                self._todo.append(item)

    def work(self, devices: Devices, jobs: int) -> None:
        """Make what is not there; Ctrl-C is heard here, and passed on when nothing is half-done."""
        self._watcher.begins(self._todo, len(self._items) - len(self._todo))
        with ExitStack() as stack:
            previews = stack.enter_context(Previews()) if self._output.preview else None
            crew = Crew(self._folder, self._output, self._fingerprints, devices, previews, self._watcher)
            left = len(self._todo)
            interrupts = stack.enter_context(Interrupts())
            try:
                crew.start(self._todo, jobs)
                while left:
                    self._record(result := crew.next(interrupts.check))
                    crew.tell(result)
                    left -= 1
                    gc.collect()  # terrains hold themselves in cycles, which take hundreds of megabytes
            finally:
                for result in crew.end(early=left > 0):
                    self._record(result)

    def add_sheets(self) -> None:
        """Write contact sheets of all that was made."""
        shown = [entry for entry in self.manifest.entries.values() if entry.state != "waiting"]
        names = sheets(self._folder, shown)
        for name in self.manifest.sheets:
            if name not in names:
                (self._folder / name).unlink(missing_ok=True)
        self.manifest.sheets = names
        self.manifest.write()

    def done(self, seconds: float) -> Done:
        """Return what came of all items."""
        todo = {item.name for item in self._todo}
        entries = [self.manifest.entries[item.name] for item in self._items]
        new = [entry for entry in entries if entry.name in todo]
        return Done(
            self.manifest,
            tuple(entry for entry in new if entry.state == "done"),
            tuple(entry for entry in entries if entry.name not in todo),
            tuple(entry for entry in new if entry.state == "partial"),
            tuple(entry for entry in new if entry.state == "failed"),
            seconds,
        )

    def _input(self, item: Item) -> str:
        """Return what an item's files follow from; nothing where its sketch is none."""
        try:
            return self._fingerprints.of(item.sketch)
        except SketchterrainError:
            return ""

    def _record(self, result: Result) -> None:
        """Keep what came of an item; of its earlier files go those that it has not any more."""
        item, entry = result
        before = self.manifest.entries[item.name]
        if entry.state == "failed":
            entry = msgspec.structs.replace(entry, files=before.files)
        else:
            for name in {each.file for each in before.files} - {each.file for each in entry.files}:
                (self._folder / item.name / name).unlink(missing_ok=True)
        self.manifest.entries[item.name] = entry
        self.manifest.write()


def _blank(item: Item, before: Entry | None = None) -> Entry:
    files = () if before is None else before.files
    return Entry(item.name, item.source.given, item.seed, dict(item.settings), files=files)


def refuse_other(folder: Path, *, resume: bool) -> None:
    """Refuse a folder that a batch cannot be written into; nothing is changed.

    Raises
    ------
    InputError
        If it or a part of its path is a file, or it holds a batch and `resume` is not given, or a broken one.
    """
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        which = "this" if there == folder else one_line(there)
        raise InputError(f"{one_line(folder)}: expected a folder to write into, {which} is a file")
    before = read_manifest(folder) if folder.is_dir() else None
    if before is not None and not resume:
        raise InputError(
            f"{one_line(folder)}: there is a batch in it ({MANIFEST}); --resume goes on with it, "
            "or take another folder"
        )


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep any other batch out of a folder; the lock ends with the process, however that ends.

    Raises
    ------
    InputError
        If there is one.
    """
    with telling_failure(folder):
        try:
            lock = lock_folder(folder)
        except BlockingIOError:
            raise InputError(f"{one_line(folder)}: another batch is at work there") from None
    try:
        yield
    finally:
        unlock_folder(lock)


def _sweep(before: Manifest) -> None:
    """Delete what a batch that was killed has left half-written."""
    for folder in (before.folder, *(before.folder / name for name in before.entries)):
        for pattern in _LEFTOVERS:
            for each in folder.glob(pattern):
                if each.is_dir() and not each.is_symlink():
                    shutil.rmtree(each, ignore_errors=True)
                else:
                    each.unlink(missing_ok=True)
