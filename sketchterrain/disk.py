"""Free disk space, bytes as text, and the user's cache folder."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from sketchterrain.errors import InputError, one_line
from sketchterrain.whole_files import wrap_os_errors


def cache_folder() -> Path:
    """Return the folder for what the program can compute again: ``$XDG_CACHE_HOME/sketchterrain``.

    Without that variable, or if it is no absolute path, ``~/.cache/sketchterrain``.
    """
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else Path("~/.cache").expanduser()) / "sketchterrain"


def free_disk_space(path: Path) -> int:
    """Return how many bytes there is room for on the disk of a file or folder, which need not be there yet."""
    with wrap_os_errors(path):
        there = next(place for place in (path, *path.absolute().parents) if place.is_dir())
        return shutil.disk_usage(there).free


def check_disk(path: Path, needed: float, what: str) -> None:
    """Refuse what the disk may have no room for, before any work is done for it."""
    left = free_disk_space(path)
    if needed > left:
        raise InputError(
            f"{what} need up to {format_bytes(needed)}, {one_line(path)} has {format_bytes(left)} left"
        )


def format_bytes(count: float) -> str:
    """Return bytes as a person reads them, MiB where they are less than one GiB.

    >>> amount(3 << 20)
    '3.0 MiB'
    """
    return gibibytes(count) if count >= 1 << 30 else f"{count / (1 << 20):.1f} MiB"


def gibibytes(count: float) -> str:
    """Return bytes as a person reads them."""
    return f"{count / (1 << 30):.1f} GiB"
