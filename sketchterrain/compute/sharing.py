"""Memory that kernels write and OpenGL draws from, in three kinds.

``extension``: OpenGL's buffer is the device's (``cl_khr_gl_sharing``). ``mapped``: a device that is the CPU
writes to where OpenGL's buffer is mapped. ``copy``: the device writes to its own memory, and what is new is
handed to OpenGL.
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
    """Return the kinds that may work in a context, the best first."""
    kinds = ["extension"] if context.gl is not None else []
    if context.device.type == "CPU":
        kinds.append("mapped")
    return (*kinds, "copy")


class MappedMemory:
    """Host memory that OpenGL has mapped for good and that a CPU device's kernels write as it stands.

    Parameters
    ----------
    context : ComputeContext
    host : ndarray of uint8
        The mapped bytes; they must stay mapped as long as this is used.
    """

    def __init__(self, context: ComputeContext, host: npt.NDArray[np.uint8]) -> None:
        self._context = context
        self.nbytes = host.nbytes
        self.buffer: Any = context.wrap_host_memory(host)

    def acquire(self) -> None:
        """Nothing to do: OpenGL must have finished with what will be written."""

    def release(self, parts: Parts) -> None:
        """Wait for the kernels; OpenCL promises that the host sees their work only where it maps it."""
        self._context.synchronize_host(self.buffer, parts)

    def close(self) -> None:
        """Give the device's part of it back."""
        self.buffer.release()


class CopiedMemory:
    """The device's own memory; what is written is handed over part by part.

    Parameters
    ----------
    context : ComputeContext
    nbytes : int
    write : callable
        Given where a part starts (bytes) and its bytes; puts them into OpenGL's buffer.
    """

    def __init__(
        self, context: ComputeContext, nbytes: int, write: Callable[[int, npt.NDArray[np.uint8]], None]
    ) -> None:
        self._context = context
        self._write = write
        self.nbytes = nbytes
        self.buffer: Any = context.empty(nbytes, np.uint8)
        self._host = np.empty(0, np.uint8)

    def acquire(self) -> None:
        """Nothing to do: the buffer is no one else's."""

    def release(self, parts: Parts) -> None:
        """Wait for the kernels and hand over what they wrote."""
        if not parts:
            return
        most = max(size for _, size in parts)
        if self._host.nbytes < most:
            self._host = np.empty(most, np.uint8)
        for start, size in parts:
            host = self._host[:size]
            self._context.download_into(self.buffer, host, start=start)
            self._write(start, host)

    def close(self) -> None:
        """Give the device's part of it back."""
        self.buffer.release()


class ExtensionMemory:
    """OpenGL's buffer itself, shared by the driver.

    Parameters
    ----------
    context : ComputeContext
        Opened beside the OpenGL context that is current.
    name : int
        OpenGL's name of the buffer.
    nbytes : int

    Raises
    ------
    DeviceError
        If the driver refuses.
    """

    def __init__(self, context: ComputeContext, name: int, nbytes: int) -> None:
        self._context = context
        self.nbytes = nbytes
        self.buffer: Any = context.from_gl(name)

    def acquire(self) -> None:
        """Take the buffer from OpenGL, which must have finished."""
        self._context.acquire_gl(self.buffer)

    def release(self, parts: Parts) -> None:
        """Wait for the kernels and give the buffer back."""
        self._context.release_gl(self.buffer)

    def close(self) -> None:
        """Give the device's part of it back."""
        self.buffer.release()
