"""Journal and ledger of a world, and what they tell of an output: nothing, a part of a world, all of it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from glob import escape
from hashlib import file_digest
from importlib.metadata import version
from itertools import chain, islice, product
from pathlib import Path
from typing import Final, Literal, NamedTuple

import filelock
import msgspec

from sketchterrain.document.store import pack_sketch
from sketchterrain.errors import InputError, one_line
from sketchterrain.io.files import wrap_os_errors, write_atomic
from sketchterrain.world.job import Job, Task, WrittenFile, fingerprint
from sketchterrain.world.store import (
    JOURNAL,
    LEDGER,
    Store,
    layer_file,
    ledger_file,
    parts_folder,
    plants_of,
    store_of,
    text_of,
)

PLANTS: Final = "plants/"
"""Begins the names of plant files in the ledger."""
_SYNC = 5.0  # s between two flushes of the journal to the disk
_THREADS: Final = 4  # a disk gives no more than they take
_BATCH: Final = 64  # files
_HEX: Final = "[0-9a-f]" * 8
# Temporary files of whole_files; GDAL takes no other ending for plants than its own.
_PARTIAL: Final = (f".*.{_HEX}.tmp", f".*.{_HEX}.fgb")
# What workers look for in the output's folder, and what each tries to write.
_PROBES: Final = (f".sketchterrain-{_HEX * 4}", f".sketchterrain-{_HEX * 4}-{_HEX}")
_ZARR_MARK: Final = b'"sketchterrain"'
_ZARR_CHUNKS: Final = "c"  # the folder of an array's shards


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The first line: the fingerprint, the program's version, and a device whose bits are its own."""

    fingerprint: str
    version: str
    device: str = ""
    format: Literal[1] = 1


class Ledger(msgspec.Struct):
    """Finished tasks with their files, and the files that belong to no task (`others`).

    The same content is a journal while the world is being written, and a sorted ledger once it is finished.
    """

    header: Header
    done: dict[Task, tuple[WrittenFile, ...]]
    others: tuple[WrittenFile, ...] = ()
    unreadable: int = 0  # lines
    finished: bool = False

    @property
    def files(self) -> Iterator[WrittenFile]:
        """All files."""
        yield from self.others
        for files in self.done.values():
            yield from files

    @property
    def bytes(self) -> int:
        """Of all files."""
        return sum(file.bytes for file in self.files)

    def text(self) -> str:
        """Return it as JSON lines: sorted, so it is the same whatever the order of the work was."""
        lines = [_line(None, sorted(self.others)), *(_line(*each) for each in sorted(self.done.items()))]
        return f"{msgspec.json.encode(self.header).decode()}\n{''.join(lines)}"


class _Line(msgspec.Struct, forbid_unknown_fields=True):
    task: Task | None
    files: tuple[WrittenFile, ...]


def _line(task: Task | None, files: Iterable[WrittenFile]) -> str:
    return f"{msgspec.json.encode(_Line(task, tuple(files))).decode()}\n"


def read_ledger(text: str, place: object) -> Ledger:
    """Read JSON lines, skipping unreadable ones: their tasks count as not done.

    Raises InputError if the first line is no header, or a file lies outside of the world's folder.
    """
    first, *lines = text.splitlines() or [""]
    try:
        ledger = Ledger(msgspec.json.decode(first, type=Header), {})
    except msgspec.MsgspecError as error:
        raise InputError(
            f"{one_line(place)}: expected a list of a world's files, this is another file or broken "
            f"({one_line(error)})"
        ) from None
    decoder = msgspec.json.Decoder(_Line)
    for line in lines:
        try:
            read = decoder.decode(line)
        except msgspec.MsgspecError:
            ledger.unreadable += 1
            continue
        if not all(is_inside(each.file) for each in read.files):
            raise InputError(f"{one_line(place)}: names a file that is not in the world's folder")
        if read.task is None:
            ledger.others = read.files
        else:
            ledger.done[read.task] = read.files
    return ledger


def read_journal(path: Path) -> Ledger | None:
    """Read a journal, whose last line may be torn; None if there is none."""
    text = text_of(path)
    return read_ledger(text, path) if text else None


class Journal:
    """Writes what is known already, whole, then appends a line for each finished task; a context manager."""

    def __init__(self, path: Path, ledger: Ledger) -> None:
        self._path = path
        with wrap_os_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, ledger.text().encode())
            self._stream = path.open("ab", buffering=0)
        self._synced = time.monotonic()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def add(self, task: Task, files: tuple[WrittenFile, ...]) -> None:
        """Append a finished task."""
        with wrap_os_errors(self._path):
            self._stream.write(_line(task, files).encode())
        if time.monotonic() - self._synced > _SYNC:
            self.sync()

    def sync(self) -> None:
        """Flush to the disk, for a power cut."""
        with wrap_os_errors(self._path):
            os.fsync(self._stream.fileno())
        self._synced = time.monotonic()


@contextmanager
def exclusive_run(output: Path) -> Iterator[None]:
    """Hold the lock of an output; raise InputError if another run holds it."""
    path = output.with_name(f".{output.name}.lock")
    with wrap_os_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = filelock.FileLock(path)
        try:
            lock.acquire(timeout=0)
        except filelock.Timeout:
            raise InputError(f"{one_line(output)}: another run is writing it") from None
    try:
        yield
    finally:
        with suppress(PermissionError):  # Windows deletes no open file
            path.unlink(missing_ok=True)
        lock.release()


@dataclass(frozen=True)
class OutputLayout:
    """The folder of the ground, and that of names that begin with ``plants/`` (None without plants)."""

    ground: Path
    plants: Path | None

    @classmethod
    def of(cls, job: Job) -> OutputLayout:
        """Return the layout of a job; raise SketchterrainError if a library that it needs is missing."""
        plants = plants_of(job)
        return cls(store_of(job).folder, None if plants is None else plants.folder)

    def path(self, name: str) -> Path:
        """Return the path of a file of the ledger; raise InputError if it is not inside the folders."""
        if not is_inside(name):
            raise InputError(f"expected the name of a file of the world, got {one_line(name)!r}")
        if self.plants is not None and name.startswith(PLANTS):
            return self.plants / name.removeprefix(PLANTS)
        return self.ground / name


def plants_folder(output: Path) -> Path:
    """Return the folder of a world's plants: ``world-plants`` beside ``world.zarr``."""
    return output.with_name(f"{output.stem if output.suffix else output.name}-plants")


def is_inside(name: str) -> bool:
    """Return whether a relative name stays inside the folder that it is looked up in."""
    parts = name.split("/")
    return all(part not in ("", ".", "..") and "\0" not in part and "\\" not in part for part in parts)


def file_record(path: Path, name: str) -> WrittenFile:
    """Return the length and the hash of a file; raise OSError if it cannot be read."""
    with path.open("rb") as stream:
        digest = file_digest(stream, "sha256").hexdigest()
        return WrittenFile(name, stream.tell(), digest)


def load_ledger(job: Job, store: Store) -> Ledger | None:
    """Return what is saved of a job's world, if anything; raise InputError if it is broken or another's."""
    ledger = read_journal(store.journal)
    if ledger is None and (text := store.ledger_text()) is not None:
        ledger = read_ledger(text, store.folder)
        ledger.finished = True
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
    return ledger


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
        load_ledger(job, store)


def remove_partial_files(job: Job, store: Store, layout: OutputLayout, whole: Collection[str]) -> None:
    """Delete what only a killed run leaves: temporary files, and Zarr shards not among the `whole`."""
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
        for level, layer in product(job.world.levels, job.layers):
            shards = (job.output / str(level.number) / layer / _ZARR_CHUNKS).rglob("*")
            _delete(path for path in shards if path.relative_to(layout.ground).as_posix() not in whole)


def _is_begun(job: Job, store: Store) -> bool:
    """Return whether a world or a part of it is there; the mark's name alone may be a user's file."""
    if (store.journal.is_file() and store.journal.stat().st_size > 0) or store.ledger_text() is not None:
        return True
    if not store.mark.is_file():
        return False
    content = store.mark.read_bytes()
    return _ZARR_MARK in content if job.form == "zarr" else content == pack_sketch(job.sketch)


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


def _delete(paths: Iterable[Path]) -> None:
    for path in list(paths):
        if not path.is_dir():
            path.unlink(missing_ok=True)


class Broken(NamedTuple):
    """A file of the ledger that is not what was written, and how it differs."""

    file: str
    why: str


def verify(ledger: Ledger, layout: OutputLayout, *, progress: Callable[[float], None]) -> Iterator[Broken]:
    """Yield files of a ledger that are missing or differ; `progress` takes the share that is read, 0 … 1."""
    files, total, read = ledger.files, max(ledger.bytes, 1), 0
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
    place, ledger = Path(path), _finished_ledger(Path(path))
    layout = OutputLayout(place if place.is_dir() else place.parent, plants_folder(place))
    return chain(broken_lines(ledger), verify(ledger, layout, progress=progress))


def broken_lines(ledger: Ledger) -> Iterator[Broken]:
    """Yield what is wrong with the ledger of a finished world itself."""
    if ledger.unreadable:
        yield Broken("ledger", f"has broken lines: {ledger.unreadable}")
    elif not ledger.others:
        yield Broken("ledger", "does not name the files that belong to the whole")


def _finished_ledger(place: Path) -> Ledger:
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
