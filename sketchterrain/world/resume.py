"""What is at a world's output before a run: nothing, a part of it, all of it, or something else."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatchcase
from glob import escape
from importlib.metadata import version
from itertools import chain, islice
from pathlib import Path
from typing import Final, NamedTuple

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch import packed_sketch
from sketchterrain.world.fingerprint import fingerprint
from sketchterrain.world.job import Job
from sketchterrain.world.journal import Ledger, OutputLayout, plants_folder, read_journal, read_ledger
from sketchterrain.world.store import (
    JOURNAL,
    LEDGER,
    Store,
    layer_file,
    ledger_file,
    parts_folder,
    store_of,
    text_of,
)
from sketchterrain.world.task_runner import file_record
from sketchterrain.world.tasks import WrittenFile

_THREADS: Final = 4  # a disk gives no more than they take
_BATCH: Final = 64  # files
_HEX: Final = "[0-9a-f]" * 8
# Temporary files of whole_files; GDAL takes no other ending for plants than its own.
_PARTIAL: Final = (f".*.{_HEX}.tmp", f".*.{_HEX}.fgb")
# What workers look for in the output's folder, and what each tries to write.
_PROBES: Final = (f".sketchterrain-{_HEX * 4}", f".sketchterrain-{_HEX * 4}-{_HEX}")
_ZARR_MARK: Final = b'"sketchterrain"'
_ZARR_CHUNKS: Final = "c"  # the folder of an array's shards


@dataclass(frozen=True)
class SavedState:
    """What a journal or a ledger says of a world, unverified; `finished` if it is the ledger."""

    ledger: Ledger
    finished: bool

    @property
    def bytes(self) -> int:
        """Of all files."""
        return sum(file.bytes for file in self.ledger.files)


def load_state(job: Job, store: Store) -> SavedState | None:
    """Return the saved state of a job's world, None if there is none.

    Raises InputError if it is another world, or the saved state is broken.
    """
    ledger, finished = read_journal(store.journal), False
    if ledger is None and (text := store.ledger_text()) is not None:
        ledger, finished = read_ledger(text, store.folder), True
    if ledger is None:
        return None
    if ledger.header.version != version("sketchterrain"):
        raise InputError(
            f"{one_line(job.output)}: was begun by version {one_line(ledger.header.version)} of the program, "
            f"this is {version('sketchterrain')}; take another output"
        )
    if ledger.header.fingerprint != fingerprint(job):
        raise InputError(
            f"{one_line(job.output)}: what is there was made from another sketch, seed, bounds or options, "
            "or by other code; take another output"
        )
    return SavedState(ledger, finished)


def check_output_unused(job: Job, *, resume: bool) -> None:
    """Refuse an output that a job's world cannot be written to; change nothing.

    Raises InputError if there is something else or another world, or a world and `resume` is not given.
    """
    store, output, place = store_of(job), job.output, one_line(job.output)
    try:
        parent = next(each for each in store.folder.parents if each.exists())
        if not parent.is_dir():
            raise InputError(f"{place}: expected a path to write to, {one_line(parent)} is a file")
        if job.form != "tif" and output.exists() and not output.is_dir():
            raise InputError(f"{place}: expected a folder to write into, this is a file")
        begun = _is_begun(job, store)
        places = () if begun else _places(job, store)
        strange = next((each for each in places if _holds_something(each, store)), None)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({error.strerror})") from None
    if strange is not None:
        raise InputError(f"{one_line(strange)}: there is something else; take another output")
    if begun and not resume:
        raise InputError(f"{place}: there is a world; --resume completes it, or take another output")
    if begun:
        load_state(job, store)


def remove_partial_files(job: Job, store: Store, layout: OutputLayout, whole: Collection[str]) -> None:
    """Delete temporary files of a killed run, and shards of a Zarr store that are not among the `whole`.

    Other files stay, since they may be the user's.
    """
    folders = {job.output, store.journal.parent, *((layout.plants,) if layout.plants is not None else ())}
    for folder in folders:
        for pattern in _PARTIAL:
            _delete(folder.rglob(pattern))
    for pattern in _PROBES:
        _delete(store.journal.parent.glob(pattern))
    if job.form == "tif":
        for file in (ledger_file(job.output), *(layer_file(job.output, each) for each in job.layers)):
            _delete(job.output.parent.glob(f".{escape(file.name)}.{_HEX}.tmp"))
    if job.form == "zarr":
        _delete(path for path in _shards(job) if path.relative_to(layout.ground).as_posix() not in whole)


def _is_begun(job: Job, store: Store) -> bool:
    """Return whether a world or a part of it is there; the mark's name alone may be a user's file."""
    if (store.journal.is_file() and store.journal.stat().st_size > 0) or store.ledger_text() is not None:
        return True
    if not store.mark.is_file():
        return False
    content = store.mark.read_bytes()
    return _ZARR_MARK in content if job.form == "zarr" else content == packed_sketch(job.sketch)


def _places(job: Job, store: Store) -> Iterator[Path]:
    """Yield the files and folders that are to be the world's."""
    yield job.output
    if job.form == "tif":
        yield from (layer_file(job.output, layer) for layer in job.layers)
        yield store.journal.parent
    if job.plants != "none":
        yield plants_folder(job.output)


def _holds_something(place: Path, store: Store) -> bool:
    """Return whether a place holds more than what a run leaves that was killed before its first file."""
    if not place.is_dir():
        return os.path.lexists(place)
    return any(
        not each.is_dir()
        and each != store.journal
        and not any(fnmatchcase(each.name, pattern) for pattern in (*_PARTIAL, *_PROBES))
        for each in place.rglob("*")
    )


def _shards(job: Job) -> Iterator[Path]:
    for level in job.world.levels:
        for layer in job.layers:
            yield from (job.output / str(level.number) / layer / _ZARR_CHUNKS).rglob("*")


def _delete(paths: Iterable[Path]) -> None:
    for path in list(paths):
        if not path.is_dir():
            path.unlink(missing_ok=True)


class Broken(NamedTuple):
    """A file of the ledger that is not what was written, and how it differs."""

    file: str
    why: str


def verify(ledger: Ledger, layout: OutputLayout, *, progress: Callable[[float], None]) -> Iterator[Broken]:
    """Read every file of a ledger again, and yield those that are missing or differ.

    `progress` takes the share of the bytes that is read, 0 … 1.
    """
    total, read = max(sum(file.bytes for file in ledger.files), 1), 0
    files = ledger.files
    with ThreadPoolExecutor(min(os.cpu_count() or 1, _THREADS), "verify") as pool:
        while some := list(islice(files, _BATCH)):
            for file, why in zip(some, pool.map(lambda each: _difference(each, layout), some), strict=True):
                read += file.bytes
                progress(read / total)
                if why:
                    yield Broken(file.file, why)


def check_world(path: str | Path, *, progress: Callable[[float], None]) -> Iterator[Broken]:
    """Verify a finished world (a Zarr store, a folder of tiles, or the GeoTIFF of the heights).

    Raises InputError if there is no ledger, it is broken, or the world is not finished.
    """
    place = Path(path)
    ledger = _ledger(place)
    layout = OutputLayout(place if place.is_dir() else place.parent, plants_folder(place))
    return chain(broken_lines(ledger), verify(ledger, layout, progress=progress))


def broken_lines(ledger: Ledger) -> Iterator[Broken]:
    """Yield what is wrong with the ledger of a finished world itself."""
    if ledger.unreadable:
        yield Broken("ledger", f"has broken lines: {ledger.unreadable}")
    elif not ledger.others:
        yield Broken("ledger", "does not name the files that belong to the whole")


def _ledger(place: Path) -> Ledger:
    if place.is_dir():
        zarr = place / "ledger"
        candidates = [(zarr / "c" / "0", zarr / JOURNAL), (place / LEDGER, place / JOURNAL)]
    else:
        candidates = [(ledger_file(place), parts_folder(place) / JOURNAL)]
    for path, journal in candidates:
        if read_journal(journal) is not None:
            raise InputError(f"{one_line(place)}: is not finished; world --resume completes it")
        if (text := text_of(path)) is not None:
            return read_ledger(text, path)
    raise InputError(f"{one_line(place)}: no ledger of a world's files is there")


def _difference(file: WrittenFile, layout: OutputLayout) -> str:
    """Return how a file differs from what was written; empty if it does not."""
    path = layout.path(file.file)
    try:
        size = path.stat().st_size
        if size != file.bytes:
            return f"has {size} bytes, {file.bytes} were written"
        return "" if file_record(path, file.file) == file else "has other bytes than were written"
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read ({error.strerror})"
