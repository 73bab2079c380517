"""Journal and ledger of a world's files: writing, reading, verification, and checks of the output."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from glob import escape
from importlib.metadata import version
from itertools import chain, islice
from pathlib import Path
from typing import Final, Literal, NamedTuple

import msgspec

from sketchterrain.errors import InputError, one_line
from sketchterrain.io.files import wrap_os_errors, wrap_read_errors, write_atomic
from sketchterrain.world.job import (
    Form,
    Job,
    OutputLayout,
    Task,
    WrittenFile,
    check_libraries,
    job_fingerprint,
    layer_file,
    read_text,
)

_THREADS: Final = 4  # more do not speed up reading from a disk
_BATCH: Final = 64  # files
_HEX: Final = "[0-9a-f]" * 8
# Temporary files of atomic_path, and of GDAL, which requires its own extension.
_PARTIAL: Final = (f".*.{_HEX}.tmp", f".*.{_HEX}.fgb")
# Probe of the output's folder by workers, and files that each of them tries to write.
_PROBES: Final = (f".sketchterrain-{_HEX * 4}", f".sketchterrain-{_HEX * 4}-{_HEX}")


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """First line: fingerprint, program version, and the device if its results deviate from other devices."""

    fingerprint: str
    version: str
    device: str = ""
    format: Literal[1] = 1


class Ledger(msgspec.Struct):
    """Finished tasks with their files, and files that belong to no task (`others`).

    The content is a journal while the world is being written, and a sorted ledger once it is finished.
    """

    header: Header
    done: dict[Task, tuple[WrittenFile, ...]]
    others: tuple[WrittenFile, ...] = ()
    unreadable: int = 0  # lines
    finished: bool = False

    @property
    def files(self) -> Iterator[WrittenFile]:
        """All files."""
        return chain(self.others, chain.from_iterable(self.done.values()))

    @property
    def bytes(self) -> int:
        """Size of all files."""
        return sum(file.bytes for file in self.files)

    def text(self) -> str:
        """Return sorted JSON lines, independent of the order of the tasks."""
        lines = [_line(None, sorted(self.others)), *(_line(*each) for each in sorted(self.done.items()))]
        return f"{msgspec.json.encode(self.header).decode()}\n{''.join(lines)}"


class _JournalLine(msgspec.Struct, forbid_unknown_fields=True):
    task: Task | None
    files: tuple[WrittenFile, ...]


def _line(task: Task | None, files: Iterable[WrittenFile]) -> str:
    return f"{msgspec.json.encode(_JournalLine(task, tuple(files))).decode()}\n"


def read_ledger(text: str, source: object) -> Ledger:
    """Read JSON lines, skipping unreadable ones: their tasks count as not done.

    Raise InputError if the header is invalid, or a file name leads outside the world's folder.
    """
    first, *lines = text.splitlines() or [""]
    try:
        ledger = Ledger(msgspec.json.decode(first, type=Header), {})
    except msgspec.MsgspecError as error:
        raise InputError(
            f"{one_line(source)}: expected a ledger of a world's files ({one_line(error)})"
        ) from None
    decoder = msgspec.json.Decoder(_JournalLine)
    for line in lines:
        try:
            entry = decoder.decode(line)
        except msgspec.MsgspecError:
            ledger.unreadable += 1
            continue
        if not all(_is_inside(each.file) for each in entry.files):
            raise InputError(f"{one_line(source)}: file name outside the world's folder")
        if entry.task is None:
            ledger.others = entry.files
        else:
            ledger.done[entry.task] = entry.files
    return ledger


def _is_inside(name: str) -> bool:
    parts = name.split("/")
    return all(part not in ("", ".", "..") and "\0" not in part and "\\" not in part for part in parts)


def read_journal(path: Path) -> Ledger | None:
    """Read a journal, whose last line may be incomplete; None if it is missing or empty."""
    text = read_text(path)
    return read_ledger(text, path) if text else None


class Journal:
    """Journal on disk: the known ledger, then a line per finished task; a context manager."""

    def __init__(self, path: Path, ledger: Ledger) -> None:
        self._path = path
        with wrap_os_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, ledger.text().encode())
            self._stream = path.open("ab", buffering=0)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def add(self, task: Task, files: tuple[WrittenFile, ...]) -> None:
        """Append a finished task, flushed to the disk, so that it survives a power cut."""
        with wrap_os_errors(self._path):
            self._stream.write(_line(task, files).encode())
            os.fsync(self._stream.fileno())


def load_ledger(job: Job) -> Ledger | None:
    """Return the journal or ledger of a job's world, None if missing; raise InputError if not of this job."""
    layout = job.layout
    ledger = read_journal(layout.journal)
    if ledger is None and (text := read_text(layout.ledger)) is not None:
        ledger = read_ledger(text, layout.folder)
        ledger.finished = True
    if ledger is None:
        return None
    if ledger.header.version != version("sketchterrain"):
        raise InputError(
            f"{one_line(job.output)}: was started by version {one_line(ledger.header.version)} of the "
            f"program, this is {version('sketchterrain')}; choose another output"
        )
    if ledger.header.fingerprint != job_fingerprint(job):
        raise InputError(
            f"{one_line(job.output)}: was computed from another sketch, seed, bounds or options, "
            "or by other code; choose another output"
        )
    return ledger


def check_output_unused(job: Job, *, resume: bool) -> None:
    """Raise InputError if an output holds other files, or the job's world and `resume` is False.

    Raise SketchterrainError if a required library is missing.
    """
    check_libraries(job)
    layout, output, name = job.layout, job.output, one_line(job.output)
    with wrap_read_errors(output):
        parent = next(each for each in layout.folder.parents if each.exists())
        if not parent.is_dir():
            raise InputError(f"{name}: expected a path to write to, {one_line(parent)} is a file")
        if job.form != "tif" and output.exists() and not output.is_dir():
            raise InputError(f"{name}: expected a folder to write into, this is a file")
        if load_ledger(job) is not None:
            if not resume:
                raise InputError(f"{name}: world exists; --resume completes it, or choose another output")
            return
        outputs = [output]
        if job.form == "tif":
            outputs += [*(layer_file(output, layer) for layer in job.layers), layout.journal.parent]
        if job.plants != "none":
            outputs.append(layout.plants)
        used = next((each for each in outputs if _is_used(each)), None)
    if used is not None:
        raise InputError(f"{one_line(used)}: holds other files; choose another output")


def _is_used(path: Path) -> bool:
    if not path.is_dir():
        return os.path.lexists(path)
    return any(
        not each.is_dir() and not any(fnmatchcase(each.name, pattern) for pattern in _PARTIAL)
        for each in path.rglob("*")
    )


def remove_partial_files(job: Job) -> None:
    """Delete temporary files of a killed run."""
    layout = job.layout
    folders = {job.output, layout.journal.parent, *(() if job.plants == "none" else (layout.plants,))}
    paths = [path for folder in folders for pattern in _PARTIAL for path in folder.rglob(pattern)]
    paths += [path for pattern in _PROBES for path in layout.journal.parent.glob(pattern)]
    if job.form == "tif":
        for file in (layout.ledger, *(layer_file(job.output, each) for each in job.layers)):
            paths += job.output.parent.glob(f".{escape(file.name)}.{_HEX}.tmp")
    for path in paths:
        if not path.is_dir():
            path.unlink(missing_ok=True)


class BrokenFile(NamedTuple):
    """A file of the ledger that is missing or changed, and the reason."""

    file: str
    reason: str


def verify(
    ledger: Ledger, layout: OutputLayout, *, progress: Callable[[float], None]
) -> Iterator[BrokenFile]:
    """Yield files of a ledger that are missing or changed; report the share read, 0 … 1."""
    files, total, read = ledger.files, max(ledger.bytes, 1), 0
    with ThreadPoolExecutor(min(os.cpu_count() or 1, _THREADS), "verify") as pool:
        while batch := list(islice(files, _BATCH)):
            reasons = pool.map(lambda each: _difference(each, layout), batch)
            for file, reason in zip(batch, reasons, strict=True):
                read += file.bytes
                progress(read / total)
                if reason:
                    yield BrokenFile(file.file, reason)


def check_world(path: str | Path, *, progress: Callable[[float], None]) -> Iterator[BrokenFile]:
    """Verify a finished world (Zarr store, folder of tiles, or GeoTIFF of the heights).

    Raise InputError if the ledger is missing or invalid, or the world is not finished.
    """
    output = Path(path)
    forms: tuple[Form, ...] = ("zarr", "tiles") if output.is_dir() else ("tif",)
    for layout in (OutputLayout.of(output, form) for form in forms):
        if read_journal(layout.journal) is not None:
            raise InputError(f"{one_line(output)}: is not finished; world --resume completes it")
        if (text := read_text(layout.ledger)) is not None:
            ledger = read_ledger(text, layout.ledger)
            return chain(broken_lines(ledger), verify(ledger, layout, progress=progress))
    raise InputError(f"{one_line(output)}: expected a world, its ledger is missing")


def broken_lines(ledger: Ledger) -> Iterator[BrokenFile]:
    """Yield errors of the ledger of a finished world itself."""
    if ledger.unreadable:
        yield BrokenFile("ledger", f"has unreadable lines: {ledger.unreadable}")
    elif not ledger.others:
        yield BrokenFile("ledger", "does not list the metadata files")


def _difference(file: WrittenFile, layout: OutputLayout) -> str:
    path = layout.path(file.file)
    try:
        size = path.stat().st_size
        if size != file.bytes:
            return f"has {size} bytes, expected {file.bytes}"
        return "" if WrittenFile.from_path(path, file.file) == file else "has changed content"
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read ({error.strerror})"
