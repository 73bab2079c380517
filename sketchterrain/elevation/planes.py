"""Spline coefficients of the levels of a DEM grid, in chunks: in memory, or in a file read when needed."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy import typing as npt

from sketchterrain.array_types import Float32Array
from sketchterrain.caching import LRUCache
from sketchterrain.errors import SketchterrainError, one_line

DESCRIPTION: Final = "table.npz"
"""File of a store beside its coefficients: without it the store is built again."""

CHUNK: Final = (112, 224)
"""Rows and columns of a chunk."""

UInt32Array: TypeAlias = npt.NDArray[np.uint32]


class DamagedStoreError(SketchterrainError):
    """A store of patches whose content has changed on disk."""


class ArrayFile:
    """Items of one shape and type in a file, read and written by slices; it is open only meanwhile."""

    def __init__(self, path: Path, dtype: Any, shape: tuple[int, ...] = ()) -> None:
        self.path, self._dtype, self._shape = path, np.dtype(dtype), shape
        self._size = self._dtype.itemsize * int(np.prod(shape, dtype=np.int64))

    def __len__(self) -> int:
        """Return the number of items."""
        return int(self.path.stat().st_size // self._size)

    def __getitem__(self, part: slice) -> Any:
        """Return some items; raise DamagedStoreError if they cannot be read."""
        found = np.empty((part.stop - part.start, *self._shape), self._dtype)
        try:
            with self.path.open("rb", buffering=0) as file:
                file.seek(part.start * self._size)
                count = file.readinto(found.reshape(-1).view(np.uint8).data)
        except OSError:
            raise self.damaged() from None
        if count != found.nbytes:
            raise self.damaged()
        return found

    def __setitem__(self, part: slice, items: Any) -> None:
        """Write some items; the file must exist."""
        with self.path.open("r+b", buffering=0) as file:
            file.seek(part.start * self._size)
            file.write(np.ascontiguousarray(items, self._dtype).reshape(-1).view(np.uint8).data)

    def damaged(self) -> DamagedStoreError:
        """Return an error; the store is built again when it is next opened."""
        self.path.with_name(DESCRIPTION).unlink(missing_ok=True)
        return DamagedStoreError(
            f"{one_line(self.path)}: has been damaged; it is built again when next opened"
        )


class CoefficientPlanes:
    """Coefficients of each level (rows, columns), in chunks of one size, by level, row and column.

    Those of a file are checked by `sums`, one of each chunk, and held in `memory`.
    """

    def __init__(
        self,
        shapes: Sequence[tuple[int, int]],
        values: Float32Array | ArrayFile | None = None,
        sums: UInt32Array | None = None,
        memory: LRUCache | None = None,
    ) -> None:
        self.shapes, self._memory = list(shapes), memory
        self._across = [-(-columns // CHUNK[1]) for _, columns in shapes]
        counts = [
            -(-rows // CHUNK[0]) * across for (rows, _), across in zip(shapes, self._across, strict=True)
        ]
        self._first = np.cumsum([0, *counts]).tolist()  # chunk of each level, and the end
        self.values: Any = np.empty((self.size, *CHUNK), np.float32) if values is None else values
        self.sums = np.zeros(self.size, np.uint32) if sums is None else sums

    @property
    def size(self) -> int:
        """Number of chunks."""
        return int(self._first[-1])

    def write(self, level: int, row: int, values: Float32Array) -> None:
        """Write a row of chunks."""
        across = self._across[level]
        whole = np.zeros((CHUNK[0], across * CHUNK[1]), np.float32)
        whole[: len(values), : values.shape[1]] = values
        chunks = np.ascontiguousarray(whole.reshape(CHUNK[0], across, CHUNK[1]).swapaxes(0, 1))
        part = slice(self._first[level] + row * across, self._first[level] + (row + 1) * across)
        self.values[part], self.sums[part] = chunks, [zlib.crc32(each.data) for each in chunks]

    def rows(self, level: int, first: int, last: int) -> Float32Array:
        """Return rows of a level."""
        across, start = self._across[level], self._first[level]
        top, bottom = first // CHUNK[0], -(-last // CHUNK[0])
        chunks = self.values[start + top * across : start + bottom * across]
        whole = chunks.reshape(-1, across, *CHUNK).swapaxes(1, 2).reshape(-1, across * CHUNK[1])
        part = whole[first - CHUNK[0] * top : last - CHUNK[0] * top, : self.shapes[level][1]]
        return np.ascontiguousarray(part)

    def copy_window(self, level: int, row: int, column: int, target: Float32Array) -> None:
        """Copy coefficients from a row and column on."""
        rows, columns = target.shape
        for i in range(row // CHUNK[0], (row + rows - 1) // CHUNK[0] + 1):
            top = max(row - CHUNK[0] * i, 0)
            to = slice(CHUNK[0] * i + top - row, CHUNK[0] * (i + 1) - row)
            for j in range(column // CHUNK[1], (column + columns - 1) // CHUNK[1] + 1):
                left = max(column - CHUNK[1] * j, 0)
                into = target[to, CHUNK[1] * j + left - column : CHUNK[1] * (j + 1) - column]
                chunk = self._chunk(self._first[level] + i * self._across[level] + j)
                into[:] = chunk[top : top + into.shape[0], left : left + into.shape[1]]

    def _chunk(self, number: int) -> Float32Array:
        def read() -> Float32Array:
            chunk: Float32Array = self.values[number : number + 1][0]
            if self._memory is not None and zlib.crc32(chunk.data) != self.sums[number]:
                raise self.values.damaged()
            return chunk

        if self._memory is None:
            return read()
        return self._memory.get_or_compute((self.values.path, number), read)
