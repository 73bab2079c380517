"""Rasters as raw numbers, NumPy files and OpenEXR images."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sketchterrain.whole_files import atomic_file, atomic_path, wrap_os_errors


def write_raw(path: Path, values: npt.NDArray[np.generic], dtype: str) -> Path:
    """Write numbers row by row without a header, in a NumPy dtype such as ``<u2`` or ``>u2``."""
    with atomic_file(path) as stream:
        stream.write(np.ascontiguousarray(values, dtype).view(np.uint8).data)
    return path


def write_npy(path: Path, values: npt.NDArray[np.generic]) -> Path:
    """Write an array for ``numpy.load``, little-endian."""
    with atomic_file(path) as stream:
        np.save(stream, np.ascontiguousarray(values, values.dtype.newbyteorder("<")))
    return path


@contextmanager
def npy_rows(path: Path, dtype: np.dtype[np.void]) -> Iterator[Callable[[npt.NDArray[np.void]], None]]:
    """Yield a function that appends rows to a structured array in a file of any length."""
    count, dtype = 0, dtype.newbyteorder("<")
    head = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False}
    with atomic_file(path) as stream:
        # NumPy pads the header so that it is equally long for any number of rows.
        np.lib.format.write_array_header_1_0(stream, head | {"shape": (0,)})

        def add(rows: npt.NDArray[np.void]) -> None:
            nonlocal count
            with wrap_os_errors(path):
                stream.write(rows.astype(dtype, order="C").view(np.uint8).data)
            count += len(rows)

        yield add
        stream.seek(0)
        np.lib.format.write_array_header_1_0(stream, head | {"shape": (count,)})


def write_exr(path: Path, channels: Mapping[str, npt.NDArray[np.float32]]) -> Path:
    """Write named channels, (rows, columns) float32 each, losslessly, including the bits of NaN."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    # The library ignores strides.
    planes = {name: np.ascontiguousarray(plane, np.float32) for name, plane in channels.items()}
    with atomic_path(path) as temporary:
        try:
            OpenEXR.File(header, planes).write(str(temporary))
        except RuntimeError as error:  # 'Failed to … file "…". No space left on device.'
            raise OSError(str(error).rpartition('". ')[2].rstrip(".")) from error
    return path
