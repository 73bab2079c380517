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
    """Coefficients of each level (rows, columns), in chunks.

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
        self._starts = np.cumsum([0, *(rows * columns for rows, columns in shapes)]).tolist()
        chunks = [(-(-rows // CHUNK[0]), -(-columns // CHUNK[1])) for rows, columns in shapes]
        self._first = np.cumsum([0, *(rows * columns for rows, columns in chunks)]).tolist()
        self._across = [columns for _, columns in chunks]
        self.values: Any = np.empty(self._starts[-1], np.float32) if values is None else values
        self.sums = np.zeros(self._first[-1], np.uint32) if sums is None else sums

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return int(self._starts[-1])

    def write(self, level: int, row: int, values: Float32Array) -> None:
        """Write a row of chunks."""
        first = self._first[level] + row * self._across[level]
        parts = [values[:, start : start + CHUNK[1]] for start in range(0, values.shape[1], CHUNK[1])]
        content = np.concatenate([each.ravel() for each in parts])
        start = self._starts[level] + CHUNK[0] * row * values.shape[1]
        self.values[start : start + len(content)] = content
        at = 0
        for number, each in enumerate(parts, start=first):
            self.sums[number] = zlib.crc32(content[at : at + each.size].data)
            at += each.size

    def rows(self, level: int, first: int, last: int) -> Float32Array:
        """Return rows of a level."""
        rows, columns = self.shapes[level]
        found = np.empty((last - first, columns), np.float32)
        for row in range(first // CHUNK[0], -(-last // CHUNK[0])):
            top, height = CHUNK[0] * row, min(CHUNK[0], rows - CHUNK[0] * row)
            start = self._starts[level] + top * columns
            content, at = self.values[start : start + height * columns], 0
            low, high = max(first, top), min(last, top + height)
            for left in range(0, columns, CHUNK[1]):
                width = min(CHUNK[1], columns - left)
                chunk = content[at : at + height * width].reshape(height, width)
                found[low - first : high - first, left : left + width] = chunk[low - top : high - top]
                at += height * width
        return found

    def copy_window(self, level: int, row: int, column: int, target: Float32Array) -> None:
        """Copy coefficients from a row and column on."""
        rows, columns = target.shape
        for i in range(row // CHUNK[0], (row + rows - 1) // CHUNK[0] + 1):
            top = max(row - CHUNK[0] * i, 0)
            to = slice(CHUNK[0] * i + top - row, CHUNK[0] * (i + 1) - row)
            for j in range(column // CHUNK[1], (column + columns - 1) // CHUNK[1] + 1):
                left = max(column - CHUNK[1] * j, 0)
                into = target[to, CHUNK[1] * j + left - column : CHUNK[1] * (j + 1) - column]
                into[:] = self._chunk(level, i, j)[top : top + into.shape[0], left : left + into.shape[1]]

    def _chunk(self, level: int, i: int, j: int) -> Float32Array:
        rows, columns = self.shapes[level]
        height, width = min(CHUNK[0], rows - CHUNK[0] * i), min(CHUNK[1], columns - CHUNK[1] * j)
        start = self._starts[level] + CHUNK[0] * i * columns + height * CHUNK[1] * j
        number = self._first[level] + i * self._across[level] + j

        def read() -> Float32Array:
            values: Float32Array = self.values[start : start + height * width]
            if self._memory is not None and zlib.crc32(values.data) != self.sums[number]:
                raise self.values.damaged()
            return values.reshape(height, width)

        return (
            read() if self._memory is None else self._memory.get_or_compute((self.values.path, number), read)
        )
