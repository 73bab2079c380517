"""Files that are whole or not there: written beside their place, flushed to disk, then renamed into it."""

from __future__ import annotations

import io
import json
import os
import secrets
import tempfile
from contextlib import contextmanager
from typing import TYPE_CHECKING

from PIL import Image

from sketchterrain.errors import InputError, SketchterrainError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Any

    import numpy as np
    import numpy.typing as npt

__all__ = ["prepare_folder", "write_json", "write_png", "write_whole"]

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
    with _telling_failure(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


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
    with _telling_failure(path):
        try:
            with temporary.open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    return path


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


@contextmanager
def _telling_failure(path: Path) -> Iterator[None]:
    """Let a failure to write say where, in one line, and not name the temporary file."""
    try:
        yield
    except OSError as error:
        raise SketchterrainError(f"{path}: cannot be written ({error.strerror or error})") from error
