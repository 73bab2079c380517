"""Atomic file writes, free disk space, the user's cache folder, and untrusted zip archives."""

import os
import secrets
import shutil
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import file_digest
from pathlib import Path
from typing import BinaryIO

from sketchterrain.errors import InputError, SketchterrainError, format_value, one_line


@contextmanager
def wrap_os_errors(path: Path) -> Iterator[None]:
    """Raise an OSError as a one-line SketchterrainError that names `path` instead of a temporary file."""
    try:
        yield
    except OSError as error:
        reason = one_line(error.strerror or error)
        raise SketchterrainError(f"{one_line(path)}: cannot be written ({reason})") from error


@contextmanager
def wrap_read_errors(path: Path | str) -> Iterator[None]:
    """Raise an OSError as an InputError that `path` cannot be read."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({one_line(error.strerror or error)})") from None


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to, which is flushed and renamed to `path` at the end.

    A reader finds the old or the new content, even after a crash; after an error the old file is unchanged.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    with wrap_os_errors(path):
        try:
            yield temporary
            with temporary.open("rb") as stream:
                os.fsync(stream.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Yield a stream to write a file as `atomic_path` does."""
    with atomic_path(path) as temporary, temporary.open("xb") as stream:
        yield stream


def write_atomic(path: Path, content: bytes) -> Path:
    """Write a file as `atomic_path` does, and return its path."""
    with atomic_file(path) as stream:
        stream.write(content)
    return path


def relative_path(path: str, base: Path) -> str:
    """Return a path inside a folder relative to it, with ``/``; another one as it is."""
    folder = base.absolute()
    return Path(path).relative_to(folder).as_posix() if Path(path).is_relative_to(folder) else path


def hash_file(path: Path) -> tuple[int, str]:
    """Return the length of a file and its SHA-256 as hexadecimal digits; raise OSError."""
    with path.open("rb") as stream:
        digest = file_digest(stream, "sha256").hexdigest()
        return stream.tell(), digest


def cache_folder() -> Path:
    """Return ``$XDG_CACHE_HOME/sketchterrain``, or ``~/.cache/sketchterrain`` without an absolute path there.

    The package sets the variable where neither can be written.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path("~/.cache").expanduser()) / "sketchterrain"


def free_disk_space(path: Path) -> int:
    """Return the free bytes on the disk of a file or folder, which need not exist yet."""
    with wrap_os_errors(path):
        existing = next(folder for folder in (path, *path.absolute().parents) if folder.is_dir())
        return shutil.disk_usage(existing).free


def check_disk(path: Path, needed: float, what: str) -> None:
    """Raise InputError if the disk of a path has fewer free bytes than `needed` by `what` (a plural noun)."""
    free = free_disk_space(path)
    if needed > free:
        raise InputError(
            f"{what} need up to {format_bytes(needed)}, {one_line(path)} has {format_bytes(free)} free"
        )


def format_bytes(count: float) -> str:
    """Return a byte count as text, in MiB or GiB.

    >>> format_bytes(3 << 20)
    '3.0 MiB'
    """
    return f"{count / (1 << 30):.1f} GiB" if count >= 1 << 30 else f"{count / (1 << 20):.1f} MiB"


_MAX_ENTRIES = 1000
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_DAMAGE_ERRORS = (
    *(zipfile.BadZipFile, zlib.error, struct.error),
    *(OSError, EOFError, ValueError, OverflowError, RuntimeError),
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
