"""Free disk space, byte counts as text, and the user's cache folder."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from sketchterrain.errors import InputError, one_line
from sketchterrain.whole_files import wrap_os_errors


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
