"""Atomic replacement of a sketch's folder: a reader finds the old or the new sketch, even after a crash.

Files are replaced one by one, and a crash may come in between. So all are first written to temporary files,
and once more into a hidden zip, the journal, which commits the new sketch. A reader prefers the journal, if
one is left, for each file that has not been modified since, as by a paint program.
"""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Iterable, Mapping
from pathlib import Path

from sketchterrain.errors import InputError
from sketchterrain.sketch.archive import pack_zip, read_zip
from sketchterrain.sketch.contents import read_folder
from sketchterrain.whole_files import write_atomic

JOURNAL = ".unfinished.sketch"
"""The journal of an unfinished save, which the next save removes."""

_STALE = 60 * 10**9
"""ns since the last write after which a temporary file is from a save that was killed."""


def replace_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Replace files of a folder, all or none; unchanged ones are not written.

    Raise OSError or SketchterrainError if the system cannot write there: the files are then as they were, or
    the journal exists.
    """
    folder.mkdir(parents=True, exist_ok=True)
    journal = folder / JOURNAL
    changed = {name: content for name, content in files.items() if not _has(folder / name, content)}
    _remove_stale_files(folder, (*files, JOURNAL))
    temporary: dict[str, Path] = {}
    try:
        for name, content in changed.items():
            temporary[name] = folder / f".{name}.{secrets.token_hex(4)}.tmp"
            with temporary[name].open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
        if len(changed) > 1 or journal.exists():
            write_atomic(journal, pack_zip(files))
        for name, path in temporary.items():
            path.replace(folder / name)
        journal.unlink(missing_ok=True)
    finally:
        for path in temporary.values():
            path.unlink(missing_ok=True)


def read_saved_folder(folder: Path, place: str) -> dict[str, bytes]:
    """Return the content of a sketch's files in a folder, by name, even if a save was not finished."""
    journal = folder / JOURNAL
    committed = _modified(journal)
    if not committed:
        return read_folder(folder, place)
    try:
        contents = read_zip(journal, f"{place}/{JOURNAL}")
    except InputError:
        if journal.exists():
            raise
        return read_folder(folder, place)  # the save was finished meanwhile
    newer = {name: content for name, content in contents.items() if _modified(folder / name) <= committed}
    return read_folder(folder, place, overrides=newer)


def _has(path: Path, content: bytes) -> bool:
    return path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content


def _modified(path: Path) -> int:
    """Return a file's modification time, ns; 0 if it does not exist."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _remove_stale_files(folder: Path, names: Iterable[str]) -> None:
    """Remove temporary files of saves that were killed."""
    for name in names:
        for path in folder.glob(f".{name}.????????.tmp"):
            if time.time_ns() - _modified(path) > _STALE:
                path.unlink(missing_ok=True)
