"""Arrays as plain bytes: numbers row after row, and NumPy's own files."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.whole_files import telling_failure, whole_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import numpy.typing as npt

__all__ = ["npy_rows", "write_npy", "write_raw"]

_ROWS_AT_ONCE = 256
_HEADER = 512  # bytes, enough for any of our types and counts
_MAGIC = b"\x93NUMPY\x01\x00"


def write_raw(path: Path, values: npt.NDArray[np.generic], kind: str) -> Path:
    """Write numbers row after row, nothing before and nothing after them.

    Parameters
    ----------
    path
    values
        (rows, columns).
    kind
        NumPy's code of how a number is written: ``<u2`` is uint16, the lower byte first.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file.
    """
    with whole_file(path) as stream:
        for top in range(0, len(values), _ROWS_AT_ONCE):  # bounds the memory of copies
            rows = values[top : top + _ROWS_AT_ONCE].astype(kind, order="C")
            stream.write(rows.view(np.uint8).data)
    return path


def write_npy(path: Path, values: npt.NDArray[np.generic]) -> Path:
    """Write an array as ``numpy.load`` reads it (NumPy's documentation, "NPY format", version 1.0).

    Raises
    ------
    SketchterrainError
        If the system cannot write the file.
    """
    kind = values.dtype.newbyteorder("<")
    with whole_file(path) as stream:
        stream.write(_header(kind, values.shape))
        for top in range(0, len(values), _ROWS_AT_ONCE):
            rows = values[top : top + _ROWS_AT_ONCE].astype(kind, order="C")
            stream.write(rows.view(np.uint8).data)
    return path


@contextmanager
def npy_rows(path: Path, kind: np.dtype[np.void]) -> Iterator[Callable[[npt.NDArray[np.void]], None]]:
    """Yield a function that adds rows to a structured array in a file: their number is known at the end.

    Parameters
    ----------
    path
    kind
        The rows' type.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file.
    """
    count, kind = 0, kind.newbyteorder("<")
    with whole_file(path) as stream:
        stream.write(_header(kind, (0,)))

        def add(rows: npt.NDArray[np.void]) -> None:
            nonlocal count
            with telling_failure(path):
                stream.write(rows.astype(kind, order="C").view(np.uint8).data)
            count += len(rows)

        yield add
        stream.seek(0)
        stream.write(_header(kind, (count,)))


def _header(kind: np.dtype[np.generic], shape: tuple[int, ...]) -> bytes:
    """Return a file's first bytes, equally many for any shape."""
    described = np.lib.format.dtype_to_descr(kind)
    text = f"{{'descr': {described!r}, 'fortran_order': False, 'shape': {shape!r}, }}"
    room = _HEADER - len(_MAGIC) - 2
    return _MAGIC + room.to_bytes(2, "little") + text.ljust(room - 1).encode("ascii") + b"\n"
