"""Values of vertices as PNG images: written in bands, and fast where neighbours are alike.

"Portable Network Graphics (PNG) Specification", W3C: each row is kept as its difference from the row above
(filter type 2), in one zlib stream. Of such differences run lengths and Huffman codes leave about as little
as a search for repetitions would, in a third of the time, and without Python's lock.
"""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.whole_files import whole_file

if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO

    import numpy.typing as npt

__all__ = ["write_values_png"]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_COLOUR_TYPE = {1: 0, 3: 2, 4: 6}  # by channels: grey, RGB, RGBA
_UP = 2
_ROWS_AT_ONCE = 64
_LEVEL, _WINDOW, _MEMORY = 3, 15, 9


def write_values_png(path: Path, values: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]) -> Path:
    """Write an image of numbers that are no picture's colours; row 0 is its upper edge.

    Parameters
    ----------
    path
    values
        (rows, columns) of uint8 or uint16 for grey; (rows, columns, 3 or 4) of uint8 for RGB or RGBA. Views
        of larger arrays are welcome.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file; the old one, if any, is as it was.
    """
    rows, columns = values.shape[:2]
    channels = values.shape[2] if values.ndim == 3 else 1
    width = columns * channels * values.dtype.itemsize
    packed = zlib.compressobj(_LEVEL, zlib.DEFLATED, _WINDOW, _MEMORY, zlib.Z_RLE)
    above = np.zeros((1, width), np.uint8)
    with whole_file(path) as stream:
        stream.write(_SIGNATURE)
        bits = 8 * values.dtype.itemsize
        _chunk(stream, b"IHDR", struct.pack(">IIBBBBB", columns, rows, bits, _COLOUR_TYPE[channels], 0, 0, 0))
        for top in range(0, rows, _ROWS_AT_ONCE):
            band = values[top : top + _ROWS_AT_ONCE].astype(values.dtype.newbyteorder(">"), order="C")
            own = band.view(np.uint8).reshape(len(band), width)
            filtered = np.empty((len(band), 1 + width), np.uint8)
            filtered[:, 0] = _UP
            np.subtract(own, np.concatenate([above, own[:-1]]), out=filtered[:, 1:])
            above = own[-1:]
            _chunk(stream, b"IDAT", packed.compress(filtered.data))
        _chunk(stream, b"IDAT", packed.flush())
        _chunk(stream, b"IEND", b"")
    return path


def _chunk(stream: BinaryIO, kind: bytes, content: bytes) -> None:
    if content or kind == b"IEND":
        stream.write(struct.pack(">I", len(content)) + kind + content)
        stream.write(struct.pack(">I", zlib.crc32(content, zlib.crc32(kind))))
