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
    from pathlib import Path
    from typing import Any

    import numpy as np
    import numpy.typing as npt

__all__ = ["prepare_folder", "write_json", "write_png"]

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
