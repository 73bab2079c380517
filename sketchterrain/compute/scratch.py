"""Pool of reusable device buffers."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

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
        had, buffer = self._buffers.get(name, (0, None))
        if had < size:
            buffer = self._context.empty(size, np.uint8)
            self._buffers[name] = (size, buffer)
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
