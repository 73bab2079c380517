"""Files that are whole or not there: written beside their place, flushed to disk, then renamed into it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from sketchterrain.errors import SketchterrainError, one_line


@contextmanager
def wrap_os_errors(path: Path) -> Iterator[None]:
    """Let a failure to write say where, in one line, and not name a temporary file."""
    try:
        yield
    except OSError as error:
        reason = one_line(error.strerror or error)
        raise SketchterrainError(f"{one_line(path)}: cannot be written ({reason})") from error


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a path that a library writes a file to; it gets its name once the context has ended well.

    Whoever reads that, even after a crash, finds the old content or the new. After an error or Ctrl-C the old
    file, if any, is as it was.
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
    """Yield a stream to write a file with in pieces; see :func:`atomic_path`."""
    with atomic_path(path) as temporary, temporary.open("xb") as stream:
        yield stream


def write_atomic(path: Path, content: bytes) -> Path:
    """Write a file so that whoever reads it, even after a crash, finds the old content or the new."""
    with atomic_file(path) as stream:
        stream.write(content)
    return path
