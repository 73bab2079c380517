"""A sketch's folder, replaced as a whole: whoever reads it after a crash finds the old sketch or the new one.

Files are replaced one by one, and a crash may come in between. So all of them are first written beside their
places, and once more into one hidden file, the pledge; from then on the new sketch counts. Reading takes from
a pledge that is still there each file that nobody wrote to since: a person's paint program may have.
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
"""What a save that did not come to its end leaves in the folder, until the next one."""

_STALE = 60 * 10**9
"""ns since anything was written to a temporary file after which nobody is writing it any more."""


def replace_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Replace files of a folder, all of them or none; those that have the same content are not touched."""
    folder.mkdir(parents=True, exist_ok=True)
    pledge = folder / JOURNAL
    changed = {name: content for name, content in files.items() if not _has(folder / name, content)}
    _sweep(folder, (*files, JOURNAL))
    written: dict[str, Path] = {}
    try:
        for name, content in changed.items():
            written[name] = folder / f".{name}.{secrets.token_hex(4)}.tmp"
            _write(written[name], content)
        if len(changed) > 1 or pledge.exists():
            write_atomic(pledge, pack_zip(files))
        for name, temporary in written.items():
            temporary.replace(folder / name)
        pledge.unlink(missing_ok=True)
    finally:
        for temporary in written.values():
            temporary.unlink(missing_ok=True)


def read_saved_folder(folder: Path, place: str) -> dict[str, bytes]:
    """Return the content of a sketch's files in a folder, by name, though a save was not finished."""
    pledge = folder / JOURNAL
    promised = _written(pledge)
    if not promised:
        return read_folder(folder, place)
    try:
        contents = read_zip(pledge, f"{place}/{JOURNAL}")
    except InputError:
        if pledge.exists():
            raise
        return read_folder(folder, place)  # the save came to its end meanwhile
    counts = {name: content for name, content in contents.items() if _written(folder / name) <= promised}
    return read_folder(folder, place, given=counts)


def _has(path: Path, content: bytes) -> bool:
    return path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content


def _write(path: Path, content: bytes) -> None:
    with path.open("xb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def _written(path: Path) -> int:
    """Return when something was last written to a file, ns; 0 if there is none."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _sweep(folder: Path, names: Iterable[str]) -> None:
    """Remove what saves that were killed left behind."""
    for name in names:
        for left in folder.glob(f".{name}.????????.tmp"):
            if time.time_ns() - _written(left) > _STALE:
                left.unlink(missing_ok=True)
