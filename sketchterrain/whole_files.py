"""Files that are whole or not there: written beside their place, flushed to disk, then renamed into it."""

from __future__ import annotations

import os
import secrets
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sketchterrain.errors import SketchterrainError, one_line

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["telling_failure", "write_whole"]


@contextmanager
def telling_failure(path: Path) -> Iterator[None]:
    """Let a failure to write say where, in one line, and not name a temporary file.

    Raises
    ------
    SketchterrainError
        In place of an OSError.
    """
    try:
        yield
    except OSError as error:
        reason = one_line(error.strerror or error)
        raise SketchterrainError(f"{one_line(path)}: cannot be written ({reason})") from error


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file so that whoever reads it, even after a crash, finds the old content or the new.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    SketchterrainError
        If the system cannot write it; the old file, if any, is as it was.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    with telling_failure(path):
        try:
            with temporary.open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    return path
