"""Small files of a world: written where they are not there yet, read where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.whole_files import telling_failure, write_whole

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["settle", "text_of"]


def settle(path: Path, content: bytes) -> None:
    """Write a file, whole, and its folder, unless it is there with just these bytes.

    Raises
    ------
    SketchterrainError
        If the system cannot write it.
    """
    with telling_failure(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        same = path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content
    if not same:
        write_whole(path, content)


def text_of(path: Path) -> str | None:
    """Return what a file says; None where there is none.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        return path.read_bytes().decode(errors="replace")
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({one_line(error.strerror or error)})") from None
