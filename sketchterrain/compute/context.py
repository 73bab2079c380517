"""An open device: programs, buffers, launches and what they cost."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyopencl as cl

from sketchterrain import resources
from sketchterrain.compute.device import Device, choose_device
from sketchterrain.errors import BuildError, DeviceError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

__all__ = ["ComputeContext", "KernelTime"]

# Contraction and fast-math would give other bits on other devices.
_OPTIONS = ("-cl-std=CL1.2",)


@dataclass(frozen=True)
class KernelTime:
    """Device time of one launch.

    Attributes
    ----------
    kernel : str
    seconds : float
        From the profiling events: end minus start.
    """

    kernel: str
    seconds: float


class ComputeContext:
    """An OpenCL context with one in-order queue on one device.

    Parameters
    ----------
    device
        The device, or a selector as for :func:`~sketchterrain.compute.choose_device`.
    real
        Type that the kernels' ``REAL`` stands for; ``'double'`` builds the same source as its own reference.

    Raises
    ------
    DeviceError
        If there is no such device, or it has no doubles and they are asked for.
    """

    def __init__(self, device: Device | str | None = None, *, real: str = "float") -> None:
        self.device = device if isinstance(device, Device) else choose_device(device)
        if real == "double" and not self.device.has_double:
            raise DeviceError(f"{self.device.name} has no 64-bit floats")
        self.real = real
        self.real_dtype = np.dtype(np.float64 if real == "double" else np.float32)
        self._context = cl.Context([self.device.handle])
        self._queue = cl.CommandQueue(self._context, properties=cl.command_queue_properties.PROFILING_ENABLE)
        self._kernels: dict[tuple[str, str], Any] = {}
        self._launches: list[tuple[str, Any]] | None = None

    def launch(
        self,
        file: str,
        kernel: str,
        size: Sequence[int],
        *arguments: object,
        group: Sequence[int] | None = None,
    ) -> None:
        """Enqueue one kernel.

        Parameters
        ----------
        file, kernel
            The ``.cl`` file in ``kernels/`` and the kernel's name in it; built at the first call.
        size, group
            Global and local work sizes.
        arguments
            Buffers, arrays' scalars (NumPy scalars of the exact type) in the kernel's order.
        """
        event = self._kernel(file, kernel)(
            self._queue, tuple(size), None if group is None else tuple(group), *arguments
        )
        if self._launches is not None:
            self._launches.append((kernel, event))

    def upload(self, array: npt.NDArray[Any], *, writable: bool = False) -> Any:
        """Copy an array to a new device buffer; an empty array gets a buffer of one element."""
        host = np.ascontiguousarray(array)
        if host.nbytes == 0:
            host = np.zeros(1, dtype=host.dtype)
        access = cl.mem_flags.READ_WRITE if writable else cl.mem_flags.READ_ONLY
        return cl.Buffer(self._context, access | cl.mem_flags.COPY_HOST_PTR, hostbuf=host)

    def empty(self, shape: Sequence[int] | int, dtype: npt.DTypeLike) -> Any:
        """Make an uninitialised device buffer for an array of this shape."""
        nbytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
        return cl.Buffer(self._context, cl.mem_flags.READ_WRITE, max(nbytes, 1))

    def download(self, buffer: Any, shape: Sequence[int] | int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Wait for the queue and copy a buffer into a new array."""
        array = np.empty(shape, dtype=dtype)
        self.download_into(buffer, array)
        return array

    def download_into(self, buffer: Any, array: npt.NDArray[Any]) -> None:
        """Wait for the queue and copy the start of a buffer into a contiguous array."""
        if array.nbytes:
            cl.enqueue_copy(self._queue, array, buffer)

    def start_profile(self) -> None:
        """Record each launch from now on."""
        self._launches = []

    def stop_profile(self) -> list[KernelTime]:
        """Wait for the queue, stop recording and return the device time of each launch since the start."""
        self._queue.finish()
        launches, self._launches = self._launches or [], None
        return [KernelTime(name, (e.profile.end - e.profile.start) * 1e-9) for name, e in launches]

    def _kernel(self, file: str, name: str) -> Any:
        if (file, name) not in self._kernels:
            for kernel in self._build(file).all_kernels():
                self._kernels[file, kernel.function_name] = kernel
        return self._kernels[file, name]

    def _build(self, file: str) -> Any:
        options = [*_OPTIONS, f"-DREAL={self.real}"]
        program = cl.Program(self._context, resources.source(file))
        try:
            with warnings.catch_warnings():
                # Drivers chat in the log of a build that worked.
                warnings.simplefilter("ignore", cl.CompilerWarning)
                return program.build(options=options)
        except cl.RuntimeError as error:
            raise BuildError(
                f"kernels/{file} did not build on {self.device.name} ({self.device.platform} "
                f"{self.device.driver}) with {' '.join(options)}: {error}"
            ) from error
