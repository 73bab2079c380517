"""Small files of a world: written unless they are there, read if they are."""

from __future__ import annotations

from pathlib import Path

from sketchterrain.errors import InputError, one_line
from sketchterrain.whole_files import telling_failure, write_whole


def settle(path: Path, content: bytes) -> None:
    """Write a file, whole, and its folder, unless it is there with just these bytes."""
    with telling_failure(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        same = path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content
    if not same:
        write_whole(path, content)


def text_of(path: Path) -> str | None:
    """Return the text of a file, None if there is none."""
    try:
        return path.read_bytes().decode(errors="replace")
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({one_line(error.strerror or error)})") from None
