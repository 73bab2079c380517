"""Folders to write into, and the encodings that several writers share."""

from __future__ import annotations

import io
import json
import tempfile
from typing import TYPE_CHECKING

from PIL import Image

from sketchterrain.errors import InputError
from sketchterrain.whole_files import telling_failure, write_whole

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path
    from typing import Any

    import numpy as np
    import numpy.typing as npt

__all__ = ["files_without_successor", "move_into", "prepare_folder", "write_json", "write_png"]

# Level 6 takes three times as long to save a tenth of the bytes.
_PNG_LEVEL = 3


def prepare_folder(folder: Path) -> None:
    """Make a folder, and find out now, not after the work, whether files can be written there.

    Raises
    ------
    InputError
        If there is something else in its place.
    SketchterrainError
        If the system cannot write there.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: expected a folder to write into, this is a file")
    with telling_failure(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


def files_without_successor(folder: Path, before: Iterable[str], now: Iterable[str]) -> list[Path]:
    """Return the files of a folder that were written the last time and are not this time.

    Parameters
    ----------
    folder
    before, now
        What those of the last time and of this time are called. A name that leads out of the folder is
        nobody's business here.
    """
    plain = sorted(name for name in {*before} - {*now} if _is_plain(name))
    return [folder / name for name in plain if (folder / name).is_file()]


def move_into(folder: Path, files: Iterable[Path], *, outdated: Iterable[Path] = ()) -> tuple[Path, ...]:
    """Move finished files into a folder of the same file system, over old ones, and return their new paths.

    Parameters
    ----------
    folder
    files
    outdated
        Files that go, once all others are there.

    Raises
    ------
    SketchterrainError
        If the system cannot.
    """
    moved = []
    for file in files:
        with telling_failure(folder / file.name):
            moved.append(file.replace(folder / file.name))
    for file in outdated:
        with telling_failure(file):
            file.unlink()
    return tuple(moved)


def _is_plain(name: str) -> bool:
    return name not in ("", ".", "..") and not set(name) & set("/\\\0")


def write_json(path: Path, value: Any) -> Path:
    """Write a value as JSON, indented, keys in the order given; NaN and infinities are refused."""
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    return write_whole(path, f"{text}\n".encode())


def write_png(path: Path, pixels: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> Path:
    """Write an image; row 0 is its upper edge.

    Parameters
    ----------
    path
    pixels
        (rows, columns) of uint8 or uint16 for grey; (rows, columns, 3 or 4) of uint8 for RGB or RGBA.
    """
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="PNG", compress_level=_PNG_LEVEL)
    return write_whole(path, stream.getvalue())
