"""Untrusted zip archives: every entry is checked before any is decompressed."""

from __future__ import annotations

import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sketchterrain.errors import InputError, format_value, one_line

_MAX_ENTRIES = 1000
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_DAMAGE_ERRORS = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    OSError,
    EOFError,
    ValueError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
)


class SafeZip:
    """Checked entries of an open zip; `place` is its name in errors, `names` of folders end with ``/``."""

    def __init__(self, archive: zipfile.ZipFile, place: str, largest: int, inside: str) -> None:
        self.place = place
        self._archive = archive
        self._entries = _checked_entries(archive, place, largest, inside)
        self.names = tuple(self._entries)

    def read(self, name: str, limit: int, label: str | None = None) -> bytes:
        """Return an entry's content, decompressing at most `limit` bytes whatever size the zip claims.

        Errors name it by `label`, if given.
        """
        info, place = self._entries[name], f"{self.place}/{one_line(label or name)}"
        if info.file_size > limit:
            raise too_large(place, limit)
        with self._archive.open(info) as stream:
            content = stream.read(limit + 1)
        if len(content) > limit:
            raise too_large(place, limit)
        return content


@contextmanager
def open_zip(path: Path, place: str, *, largest: int, expected: str, inside: str) -> Iterator[SafeZip]:
    """Yield the checked entries of a zip of at most `largest` bytes, unpacked too.

    `place`, `expected` and `inside` are words for errors. Raise InputError if the zip is damaged, also while
    it is being read, too large, or has an unsafe entry (``..``, absolute, a link, encrypted, duplicate).
    """
    try:
        if path.stat().st_size > largest:
            raise too_large(place, largest)
        with zipfile.ZipFile(path) as archive:
            yield SafeZip(archive, place, largest, inside)
    except _DAMAGE_ERRORS as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputError(f"{place}: expected {expected} ({one_line(reason)})") from None


def too_large(place: str, limit: int) -> InputError:
    """Return the error that a file or archive has more than `limit` bytes."""
    size = f"{limit >> 20} MiB" if limit >> 20 else f"{limit >> 10} KiB"
    return InputError(f"{place}: too large: expected at most {size}")


def _checked_entries(
    archive: zipfile.ZipFile, place: str, largest: int, inside: str
) -> dict[str, zipfile.ZipInfo]:
    infos = archive.infolist()
    if len(infos) > _MAX_ENTRIES:
        raise InputError(f"{place}: {len(infos)} entries: expected at most {_MAX_ENTRIES}")
    if sum(info.file_size for info in infos) > largest:
        raise too_large(f"{place}, unpacked", largest)
    entries: dict[str, zipfile.ZipInfo] = {}
    for info in infos:
        problem = "duplicate entry" if info.filename in entries else _problem(info, inside)
        if problem:
            raise InputError(f"{place}: entry {format_value(info.orig_filename)} refused: {problem}")
        entries[info.filename] = info
    return entries


def _problem(info: zipfile.ZipInfo, inside: str) -> str | None:
    name = info.orig_filename
    if "\\" in name or "\0" in name or ":" in name:
        return "expected a plain relative path with /"
    if name.startswith("/") or not {"", ".", ".."}.isdisjoint(name.removesuffix("/").split("/")):
        return f"expected a path inside {inside}"
    if info.flag_bits & 0x1:
        return "it is encrypted"
    if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "expected a plain file, not a link or a device"
    if info.compress_type not in _METHODS:
        return "expected stored or deflated data"
    return None
