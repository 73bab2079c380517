"""Journal and ledger of a world: JSON lines of finished tasks, with hashes and paths of their files."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import filelock
import msgspec

from sketchterrain.errors import InputError, one_line
from sketchterrain.whole_files import telling_failure, write_whole
from sketchterrain.world.job import Job
from sketchterrain.world.store import plants_of, store_of
from sketchterrain.world.tasks import Task, WrittenFile

_PLANTS: Final = "plants/"
_SYNC = 5.0  # s between two flushes of the journal to the disk


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

    @property
    def files(self) -> Iterator[WrittenFile]:
        """All files."""
        yield from self.others
        for files in self.done.values():
            yield from files

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
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    return read_ledger(text, path) if text else None


class Journal:
    """Appends a line for each finished task; a context manager.

    What is known already is written first, whole: a run that is killed amid it leaves the journal as it was.
    """

    def __init__(self, path: Path, ledger: Ledger) -> None:
        self._path = path
        with telling_failure(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, ledger.text().encode())
        with telling_failure(path):
            self._stream = path.open("ab", buffering=0)
        self._synced = time.monotonic()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def add(self, task: Task, files: tuple[WrittenFile, ...]) -> None:
        """Append a finished task."""
        with telling_failure(self._path):
            self._stream.write(_line(task, files).encode())
        if time.monotonic() - self._synced > _SYNC:
            self.sync()

    def sync(self) -> None:
        """Flush to the disk, for a power cut."""
        with telling_failure(self._path):
            os.fsync(self._stream.fileno())
        self._synced = time.monotonic()


@contextmanager
def exclusive_run(output: Path) -> Iterator[None]:
    """Hold the lock of an output; raise InputError if another run holds it."""
    path = output.with_name(f".{output.name}.lock")
    with telling_failure(path):
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

    @staticmethod
    def plant_names(names: Iterable[str]) -> tuple[str, ...]:
        """Return names of a plant store's files as the ledger has them."""
        return tuple(f"{_PLANTS}{name}" for name in names)

    def path(self, name: str) -> Path:
        """Return the path of a file of the ledger; raise InputError if it is not inside the folders."""
        if not is_inside(name):
            raise InputError(f"expected the name of a file of the world, got {one_line(name)!r}")
        if self.plants is not None and name.startswith(_PLANTS):
            return self.plants / name.removeprefix(_PLANTS)
        return self.ground / name


def plants_folder(output: Path) -> Path:
    """Return the folder of a world's plants: ``world-plants`` beside ``world.zarr``."""
    return output.with_name(f"{output.stem if output.suffix else output.name}-plants")


def is_inside(name: str) -> bool:
    """Return whether a relative name stays inside the folder that it is looked up in."""
    parts = name.split("/")
    return all(part not in ("", ".", "..") and "\0" not in part and "\\" not in part for part in parts)
