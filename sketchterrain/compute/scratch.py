"""Buffers that are needed again and again: lent, grown where they are too small, never handed out twice."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from sketchterrain.compute.context import ComputeContext


class BufferSet:
    """Named buffers of one borrower; what they hold at first is anything."""

    def __init__(self, context: ComputeContext) -> None:
        self._context = context
        self._buffers: dict[str, tuple[int, Any]] = {}

    def buffer(self, name: str, shape: Sequence[int] | int, dtype: npt.DTypeLike) -> Any:
        """Return the buffer of a name, with room for an array at least."""
        size = max(int(np.prod(shape)) * np.dtype(dtype).itemsize, 1)
        had, buffer = self._buffers.get(name, (0, None))
        if had < size:
            buffer = self._context.empty(size, np.uint8)
            self._buffers[name] = (size, buffer)
        return buffer


class BufferPool:
    """Rooms of a device that are lent one after the other, to one thread.

    New memory costs a fault a page at its first touch, more than a light kernel does with it.

    Parameters
    ----------
    context : ComputeContext
    """

    def __init__(self, context: ComputeContext) -> None:
        self._context = context
        self._free: list[BufferSet] = []

    @contextmanager
    def borrow(self) -> Iterator[BufferSet]:
        """Lend a room; it is another's after that, so nothing in it may still be waited for."""
        room = self._free.pop() if self._free else BufferSet(self._context)
        try:
            yield room
        finally:
            self._free.append(room)
