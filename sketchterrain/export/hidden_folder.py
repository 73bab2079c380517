"""A hidden folder, for files that shall come into the one around it together or not at all."""

from __future__ import annotations

import shutil
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sketchterrain.errors import SketchterrainError
from sketchterrain.system import lock_folder, unlock_folder
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
        unlock_folder(lock)


def _made(folder: Path) -> tuple[Path, int | None]:
    """Return a new hidden folder and its lock, which lasts as long as its process at most."""
    outer = lock_folder(folder, wait=True)  # so that no other process sweeps a folder that is not locked yet
    try:
        _sweep(folder)
        hidden = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=folder))
        return hidden, lock_folder(hidden, wait=True)
    finally:
        unlock_folder(outer)


def _sweep(folder: Path) -> None:
    """Delete hidden folders that no process has locked; none where folders have no locks."""
    for hidden in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            lock = lock_folder(hidden)
            if lock is not None:
                shutil.rmtree(hidden, ignore_errors=True)
                unlock_folder(lock)
