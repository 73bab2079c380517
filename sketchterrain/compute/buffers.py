"""Device buffers: a pool of reusable ones, staging of small arrays, and vertices that OpenGL draws from.

OpenGL gets vertices by three methods. ``extension``: its buffer is the device's (``cl_khr_gl_sharing``).
``mapped``: a CPU device writes to the mapped OpenGL buffer. ``copy``: the device writes to its own memory,
and changes are copied to OpenGL.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

    Ranges = Sequence[tuple[int, int]]


class BufferSet:
    """Named device buffers of one borrower; contents are undefined at first."""

    def __init__(self, context: ComputeContext) -> None:
        self._context = context
        self._buffers: dict[str, tuple[int, Any]] = {}

    def buffer(self, name: str, shape: Sequence[int] | int, dtype: npt.DTypeLike) -> Any:
        """Return the buffer of a name, large enough for an array of this shape."""
        size = max(int(np.prod(shape)) * np.dtype(dtype).itemsize, 1)
        capacity, buffer = self._buffers.pop(name, (0, None))
        if capacity < size:
            buffer = None  # free the smaller one first
            capacity, buffer = size, self._context.empty(size, np.uint8)
        self._buffers[name] = capacity, buffer
        return buffer


class BufferPool:
    """Buffer sets of a device, for one thread: page faults of new memory cost more than a light kernel."""

    def __init__(self, context: ComputeContext) -> None:
        self._context = context
        self._free: list[BufferSet] = []

    @contextmanager
    def borrow(self) -> Iterator[BufferSet]:
        """Lend a buffer set; on return nothing may still be using it."""
        sizes = self._free.pop() if self._free else BufferSet(self._context)
        try:
            yield sizes
        finally:
            self._free.append(sizes)


# Alignment of sub-buffers: valid on every device, and no two share a cache line.
_ALIGNMENT = 512
# Transfers in flight before waiting for the oldest.
_MAX_TRANSFERS = 3


class StagingBuffer:
    """One device buffer divided into named parts, each as large as the largest array uploaded to it.

    The queue is in order, so kernels still reading the previous contents are not disturbed. Arrays are copied
    and may change at once.
    """

    def __init__(self, context: ComputeContext) -> None:
        self._context = context
        self._sizes: dict[str, int] = {}
        self._start: dict[str, int] = {}
        self._parts: dict[str, Any] = {}
        self._buffer: Any = None
        self._transfers: list[tuple[npt.NDArray[np.uint8], Any]] = []

    def upload(self, arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, Any]:
        """Enqueue one transfer of arrays and return the buffer of each; it may be larger than the array."""
        if any(self._sizes.get(name, -1) < array.nbytes for name, array in arrays.items()):
            self._grow(arrays)
        host, transfer = self._transfers[0]
        if transfer is not None:
            self._context.wait(transfer)
        end = 0
        for name, array in arrays.items():
            start = self._start[name]
            host[start : start + array.nbytes] = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
            end = max(end, start + array.nbytes)
        transfer = self._context.write(self._buffer, host[:end]) if end else None
        self._transfers = [*self._transfers[1:], (host, transfer)]
        return {name: self._parts[name] for name in arrays}

    def _grow(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Grow the buffer to fit arrays; on failure nothing changes."""
        sizes = dict(self._sizes)
        for name, array in arrays.items():
            if sizes.get(name, -1) < array.nbytes:
                sizes[name] = _ALIGNMENT << max(-(-array.nbytes // _ALIGNMENT) - 1, 0).bit_length()
        ends = np.cumsum(list(sizes.values()))
        starts = ends - np.array(list(sizes.values()))
        start = {name: int(first) for name, first in zip(sizes, starts, strict=True)}
        buffer = self._context.empty(int(ends[-1]), np.uint8)
        parts = {name: self._context.sub_buffer(buffer, start[name], size) for name, size in sizes.items()}
        for _, transfer in self._transfers:
            if transfer is not None:
                self._context.wait(transfer)
        self._sizes, self._start, self._buffer, self._parts = sizes, start, buffer, parts
        self._transfers = [(np.zeros(int(ends[-1]), np.uint8), None) for _ in range(_MAX_TRANSFERS)]


def sharing_methods(context: ComputeContext) -> tuple[str, ...]:
    """Return the sharing methods that may work in a context, the best first."""
    methods = ["extension"] if context.gl is not None else []
    if context.device.type == "CPU":
        methods.append("mapped")
    return (*methods, "copy")


class _DeviceMemory:
    """Device buffer that OpenGL draws from."""

    def __init__(self, context: ComputeContext, buffer: Any, nbytes: int) -> None:
        self._context = context
        self.buffer = buffer
        self.nbytes = nbytes

    def acquire(self) -> None:
        """Acquire the buffer if it is shared; OpenGL must have finished with the ranges to be written."""

    def close(self) -> None:
        """Release the device buffer."""
        self.buffer.release()


class MappedMemory(_DeviceMemory):
    """Persistently mapped OpenGL memory (uint8) that a CPU device's kernels write in place."""

    def __init__(self, context: ComputeContext, host: npt.NDArray[np.uint8]) -> None:
        super().__init__(context, context.wrap_host_memory(host), host.nbytes)

    def release(self, ranges: Ranges) -> None:
        """Wait for the kernels; OpenCL guarantees visibility only where the host maps the ranges."""
        self._context.synchronize_host(self.buffer, ranges)


class CopiedMemory(_DeviceMemory):
    """Device memory whose written ranges are copied out by ``write(start, bytes)``."""

    def __init__(
        self, context: ComputeContext, nbytes: int, write: Callable[[int, npt.NDArray[np.uint8]], None]
    ) -> None:
        super().__init__(context, context.empty(nbytes, np.uint8), nbytes)
        self._write = write
        self._host = np.empty(0, np.uint8)

    def release(self, ranges: Ranges) -> None:
        """Wait for the kernels and copy out the ranges they wrote."""
        largest = max((size for _, size in ranges), default=0)
        if self._host.nbytes < largest:
            self._host = np.empty(largest, np.uint8)
        for start, size in ranges:
            host = self._host[:size]
            self._context.download_into(self.buffer, host, start=start)
            self._write(start, host)


class ExtensionMemory(_DeviceMemory):
    """An OpenGL buffer, by name, shared by the driver; DeviceError if the driver refuses."""

    def __init__(self, context: ComputeContext, name: int, nbytes: int) -> None:
        super().__init__(context, context.from_gl(name), nbytes)

    def acquire(self) -> None:
        """Acquire the buffer from OpenGL, which must have finished."""
        self._context.acquire_gl(self.buffer)

    def release(self, ranges: Ranges) -> None:
        """Wait for the kernels and release the buffer."""
        self._context.release_gl(self.buffer)
