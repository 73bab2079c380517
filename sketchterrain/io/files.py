"""Atomic file writes, free disk space and the user's cache folder."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from sketchterrain.errors import InputError, SketchterrainError, one_line


@contextmanager
def wrap_os_errors(path: Path) -> Iterator[None]:
    """Raise an OSError as a one-line SketchterrainError that names `path` instead of a temporary file."""
    try:
        yield
    except OSError as error:
        reason = one_line(error.strerror or error)
        raise SketchterrainError(f"{one_line(path)}: cannot be written ({reason})") from error


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


def cache_folder() -> Path:
    """Return ``$XDG_CACHE_HOME/sketchterrain``, or ``~/.cache/sketchterrain`` without an absolute path there.

    Raise RuntimeError if the user has no home folder.
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
