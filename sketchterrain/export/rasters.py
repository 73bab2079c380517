"""Rasters as raw numbers, NumPy files and OpenEXR images."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sketchterrain.whole_files import atomic_file, atomic_path, wrap_os_errors


def write_raw(path: Path, values: npt.NDArray[np.generic], kind: str) -> Path:
    """Write numbers row after row without a header; `kind` is NumPy's code, ``<u2`` or ``>u2`` say."""
    with atomic_file(path) as stream:
        stream.write(np.ascontiguousarray(values, kind).view(np.uint8).data)
    return path


def write_npy(path: Path, values: npt.NDArray[np.generic]) -> Path:
    """Write an array as ``numpy.load`` reads it, little-endian."""
    with atomic_file(path) as stream:
        np.save(stream, np.ascontiguousarray(values, values.dtype.newbyteorder("<")))
    return path


@contextmanager
def npy_rows(path: Path, kind: np.dtype[np.void]) -> Iterator[Callable[[npt.NDArray[np.void]], None]]:
    """Yield a function that appends rows to a structured array in a file of any length."""
    count, kind = 0, kind.newbyteorder("<")
    head = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False}
    with atomic_file(path) as stream:
        # NumPy pads the header so that it is equally long for any number of rows.
        np.lib.format.write_array_header_1_0(stream, head | {"shape": (0,)})

        def add(rows: npt.NDArray[np.void]) -> None:
            nonlocal count
            with wrap_os_errors(path):
                stream.write(rows.astype(kind, order="C").view(np.uint8).data)
            count += len(rows)

        yield add
        stream.seek(0)
        np.lib.format.write_array_header_1_0(stream, head | {"shape": (count,)})


def write_exr(path: Path, channels: Mapping[str, npt.NDArray[np.float32]]) -> Path:
    """Write named channels, (rows, columns) float32 each, losslessly compressed; the bits of NaN stay too."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    # The library reads memory in rows whatever an array's strides are.
    planes = {name: np.ascontiguousarray(plane, np.float32) for name, plane in channels.items()}
    with atomic_path(path) as temporary:
        try:
            OpenEXR.File(header, planes).write(str(temporary))
        except RuntimeError as error:  # 'Failed to … file "…". No space left on device.'
            raise OSError(str(error).rpartition('". ')[2].rstrip(".")) from error
    return path
