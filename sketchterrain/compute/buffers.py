"""Pools of device and host buffers."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.compute.context import ComputeContext


class BufferSet:
    """Named device buffers of one borrower; contents are undefined at first."""

    def __init__(self, context: ComputeContext) -> None:
        self._context = context
        self._buffers: dict[str, tuple[int, Any]] = {}

    def buffer(self, name: str, shape: Sequence[int] | int, dtype: npt.DTypeLike) -> Any:
        """Return the buffer of a name, large enough for an array of this shape."""
        size = max(int(np.prod(shape)) * np.dtype(dtype).itemsize, 1)
        had, buffer = self._buffers.pop(name, (0, None))
        if had < size:
            buffer = None  # free the smaller one first
            had, buffer = size, self._context.empty(size, np.uint8)
        self._buffers[name] = had, buffer
        return buffer


class BufferPool:
    """Buffer sets of a device, for one thread: page faults of new memory cost more than a light kernel."""

    def __init__(self, context: ComputeContext) -> None:
        self._context = context
        self._free: list[BufferSet] = []

    @contextmanager
    def borrow(self) -> Iterator[BufferSet]:
        """Lend a buffer set; on return nothing may still be using it."""
        room = self._free.pop() if self._free else BufferSet(self._context)
        try:
            yield room
        finally:
            self._free.append(room)


# Parts start where any device lets a buffer start, and no two of them share a cache line.
_ALIGNED = 512
# How many transfers may be under way before the oldest is waited for.
_TURNS = 3


class StagingBuffer:
    """One device buffer divided into named parts, each as large as the largest array uploaded to it.

    The queue is in order, so kernels still reading the previous contents are not disturbed. Arrays are copied
    and may change at once.
    """

    def __init__(self, context: ComputeContext) -> None:
        self._context = context
        self._room: dict[str, int] = {}
        self._start: dict[str, int] = {}
        self._parts: dict[str, Any] = {}
        self._whole: Any = None
        self._turns: list[tuple[npt.NDArray[np.uint8], Any]] = []

    def upload(self, arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, Any]:
        """Enqueue one transfer of arrays and return the buffer of each; it may be larger than the array."""
        if any(self._room.get(name, -1) < array.nbytes for name, array in arrays.items()):
            self._make_room(arrays)
        host, transfer = self._turns[0]
        if transfer is not None:
            self._context.wait(transfer)
        end = 0
        for name, array in arrays.items():
            start = self._start[name]
            host[start : start + array.nbytes] = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
            end = max(end, start + array.nbytes)
        transfer = self._context.write(self._whole, host[:end]) if end else None
        self._turns = [*self._turns[1:], (host, transfer)]
        return {name: self._parts[name] for name in arrays}

    def _make_room(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Grow the buffer to fit arrays; on failure nothing changes."""
        room = dict(self._room)
        for name, array in arrays.items():
            if room.get(name, -1) < array.nbytes:
                room[name] = _ALIGNED << max(-(-array.nbytes // _ALIGNED) - 1, 0).bit_length()
        ends = np.cumsum(list(room.values()))
        starts = ends - np.array(list(room.values()))
        start = {name: int(first) for name, first in zip(room, starts, strict=True)}
        whole = self._context.empty(int(ends[-1]), np.uint8)
        parts = {name: self._context.sub_buffer(whole, start[name], size) for name, size in room.items()}
        for _, transfer in self._turns:
            if transfer is not None:
                self._context.wait(transfer)
        self._room, self._start, self._whole, self._parts = room, start, whole, parts
        self._turns = [(np.zeros(int(ends[-1]), np.uint8), None) for _ in range(_TURNS)]
