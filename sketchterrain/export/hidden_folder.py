"""A hidden folder, for files that shall come into the one around it together or not at all."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sketchterrain.errors import SketchterrainError
from sketchterrain.whole_files import telling_failure

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["staging"]

_PREFIX: Final = ".sketchterrain-"


@contextmanager
def staging(folder: Path) -> Iterator[Path]:
    """Yield a hidden folder inside another, for files that shall come into it together or not at all.

    What is still there afterwards is deleted, and so is what was left by a process that was killed. Failures
    to write name the outer folder.

    Raises
    ------
    SketchterrainError
        If the system cannot write there.
    """
    with telling_failure(folder):
        hidden, lock = _made(folder)
    try:
        yield hidden
    except SketchterrainError as error:
        if str(hidden) not in str(error):
            raise
        raise type(error)(str(error).replace(str(hidden), str(folder))) from error
    finally:
        shutil.rmtree(hidden, ignore_errors=True)
        os.close(lock)


def _made(folder: Path) -> tuple[Path, int]:
    """Return a new hidden folder and its lock, which lasts as long as its process at most."""
    outer = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network's file systems have no locks: nothing is swept there
            fcntl.flock(outer, fcntl.LOCK_EX)  # a folder that is not locked yet must not be swept by another
        _sweep(folder)
        hidden = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=folder))
        lock = os.open(hidden, os.O_RDONLY)
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        return hidden, lock
    finally:
        os.close(outer)


def _sweep(folder: Path) -> None:
    """Delete hidden folders that no process holds."""
    for hidden in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            lock = os.open(hidden, os.O_RDONLY | os.O_DIRECTORY)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(hidden, ignore_errors=True)
            finally:
                os.close(lock)
