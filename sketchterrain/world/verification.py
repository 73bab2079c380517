"""Whether the files of a world are what was written, by their hashes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, islice
from pathlib import Path
from typing import Final, NamedTuple

from sketchterrain.errors import InputError, one_line
from sketchterrain.world.journal import Ledger, read_journal, read_ledger
from sketchterrain.world.layout import OutputLayout, plants_folder
from sketchterrain.world.store import JOURNAL, LEDGER, ledger_file, parts_folder, text_of
from sketchterrain.world.task_runner import file_record
from sketchterrain.world.tasks import WrittenFile

_THREADS: Final = 4  # a disk gives no more than they take
_BATCH: Final = 64  # files


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
