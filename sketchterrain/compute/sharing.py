"""Vertex memory that kernels write and OpenGL draws from, by three methods.

``extension``: OpenGL's buffer is the device's (``cl_khr_gl_sharing``). ``mapped``: a CPU device writes to the
mapped OpenGL buffer. ``copy``: the device writes to its own memory, and changes are copied to OpenGL.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from sketchterrain.compute.context import ComputeContext

    Parts = Sequence[tuple[int, int]]

METHODS: Final = ("extension", "mapped", "copy")


def sharing_methods(context: ComputeContext) -> tuple[str, ...]:
    """Return the methods that may work in a context, the best first."""
    kinds = ["extension"] if context.gl is not None else []
    if context.device.type == "CPU":
        kinds.append("mapped")
    return (*kinds, "copy")


class MappedMemory:
    """Persistently mapped OpenGL memory (uint8) that a CPU device's kernels write in place."""

    def __init__(self, context: ComputeContext, host: npt.NDArray[np.uint8]) -> None:
        self._context = context
        self.nbytes = host.nbytes
        self.buffer: Any = context.wrap_host_memory(host)

    def acquire(self) -> None:
        """Do nothing: OpenGL must have finished with the ranges to be written."""

    def release(self, parts: Parts) -> None:
        """Wait for the kernels; OpenCL guarantees visibility only where the host maps the ranges."""
        self._context.synchronize_host(self.buffer, parts)

    def close(self) -> None:
        """Release the device buffer."""
        self.buffer.release()


class CopiedMemory:
    """Device memory whose written ranges are copied out by ``write(start, bytes)``."""

    def __init__(
        self, context: ComputeContext, nbytes: int, write: Callable[[int, npt.NDArray[np.uint8]], None]
    ) -> None:
        self._context = context
        self._write = write
        self.nbytes = nbytes
        self.buffer: Any = context.empty(nbytes, np.uint8)
        self._host = np.empty(0, np.uint8)

    def acquire(self) -> None:
        """Do nothing: the buffer is not shared."""

    def release(self, parts: Parts) -> None:
        """Wait for the kernels and copy out the ranges they wrote."""
        if not parts:
            return
        largest = max(size for _, size in parts)
        if self._host.nbytes < largest:
            self._host = np.empty(largest, np.uint8)
        for start, size in parts:
            host = self._host[:size]
            self._context.download_into(self.buffer, host, start=start)
            self._write(start, host)

    def close(self) -> None:
        """Release the device buffer."""
        self.buffer.release()


class ExtensionMemory:
    """An OpenGL buffer, by name, shared by the driver; DeviceError if the driver refuses."""

    def __init__(self, context: ComputeContext, name: int, nbytes: int) -> None:
        self._context = context
        self.nbytes = nbytes
        self.buffer: Any = context.from_gl(name)

    def acquire(self) -> None:
        """Acquire the buffer from OpenGL, which must have finished."""
        self._context.acquire_gl(self.buffer)

    def release(self, parts: Parts) -> None:
        """Wait for the kernels and release the buffer."""
        self._context.release_gl(self.buffer)

    def close(self) -> None:
        """Release the device buffer."""
        self.buffer.release()
