"""OpenCL context: programs, launches, transfers, and the meaning of failures.

Run as a program, it compiles programs and stores them for the process that started it.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Hashable, Iterable, Sequence
from contextlib import suppress
from functools import cache
from threading import Lock, Thread, main_thread
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt
import pyopencl as cl
from pyopencl.characterize import has_src_build_cache

from sketchterrain.compute import gl_interop
from sketchterrain.compute.device import Device, choose_device, list_devices
from sketchterrain.compute.gl_interop import GLHandles
from sketchterrain.errors import (
    BuildError,
    DeviceError,
    DeviceFailedError,
    DeviceMemoryError,
    SketchterrainError,
    one_line,
)
from sketchterrain.io import resources
from sketchterrain.io.disk_cache import cached_bytes, is_cached
from sketchterrain.io.resources import Defines
from sketchterrain.io.system import module_command

_STATUS = cl.status_code
# CL_OUT_OF_RESOURCES is not one of them: drivers report it for crashed kernels too.
_OUT_OF_MEMORY = {
    _STATUS.MEM_OBJECT_ALLOCATION_FAILURE,
    _STATUS.OUT_OF_HOST_MEMORY,
    _STATUS.INVALID_BUFFER_SIZE,  # larger than the device allocates at once
}
_MAX_LOG = 200  # characters


def call_error(device: Device, action: str, error: cl.Error) -> DeviceError:
    """Return the exception to raise for an OpenCL error; `action` is for example ``"launching patches"``."""
    reason = one_line(" ".join(str(error).split()))
    where = f"{device.name} ({device.platform})"
    if isinstance(error, cl.MemoryError) or _code(error) in _OUT_OF_MEMORY:
        return DeviceMemoryError(f"{where} has no memory left for {action}: {reason}")
    return DeviceFailedError(f"{where} failed at {action}: {reason}")


def build_error(device: Device, file: str, options: tuple[str, ...], error: cl.Error) -> BuildError:
    """Return one line with the kernel's file, the device, the options and the log's first error."""
    return BuildError(
        f"kernels/{file} did not build on {device.name} ({device.platform} {device.driver}) "
        f"with {' '.join(options)}: {_first_error(str(error))} (SKETCHTERRAIN_DEBUG=1 shows the whole log)"
    )


def _code(error: cl.Error) -> int | None:
    try:
        return int(error.code)
    except (AttributeError, TypeError):  # raised by pyopencl itself, not by the driver
        return None


def _first_error(log: str) -> str:
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    message = next((line for line in lines if "error:" in line.lower()), lines[0] if lines else "no log")
    return one_line(message[:_MAX_LOG])


_OPTIONS = ("-cl-std=CL1.2",)
# These allow reordering and contraction, so bits differ between devices.
_FAST_OPTIONS = ("-DFAST", "-cl-fast-relaxed-math")

T = TypeVar("T")

_BUILDING: Final[dict[Hashable, Lock]] = {}  # by program: threads need not all build the same
_COMPILERS: Final[dict[str, subprocess.Popen[bytes]]] = {}  # child processes by what they compile
# Drivers write to the log of successful builds, and no filter of warnings holds in all threads.
cl.compiler_output = lambda _: None
_MAX_BINARIES: Final = 64 << 20  # bytes; a program has up to 1 MiB
_POLL: Final = 0.02  # s between looks for what a child compiles


class ComputeContext:
    """An OpenCL context with one in-order queue on one device.

    `device` is a device or a selector as for :func:`choose_device`; `real` is the type
    that the kernels' ``REAL`` stands for (``'double'`` builds the same source as its own reference); `fast`
    lets the compiler trade bits for speed; `gl` is an OpenGL context to share buffers with.

    Raises DeviceError if there is no such device, or it lacks doubles or buffer sharing. This and every
    method raise DeviceFailedError where the device fails and DeviceMemoryError where it is out of memory; the
    failure of a launch may surface only when its results are downloaded.
    """

    def __init__(
        self,
        device: Device | str | None = None,
        *,
        real: str = "float",
        fast: bool = False,
        gl: GLHandles | None = None,
    ) -> None:
        self.device = device if isinstance(device, Device) else choose_device(device)
        if real == "double" and not self.device.has_double:
            raise DeviceError(f"{self.device.name} has no 64-bit floats")
        self.real = real
        self.fast = fast
        self.real_dtype = np.dtype(np.float64 if real == "double" else np.float32)
        self.gl = gl
        self._context = self._call("opening", _opened, self.device.twin_of or self.device, gl)
        profiling = cl.command_queue_properties.PROFILING_ENABLE
        self._queue = self._call("opening", cl.CommandQueue, self._context, properties=profiling)
        self._kernels: dict[tuple[str, str, Defines], Any] = {}

    def build_ahead(self, programs: Iterable[tuple[str, Defines]]) -> None:
        """Build files with macros on a thread, in this order; a launch waits for its own program at most.

        Where we store programs, a child process compiles them: compilers of drivers keep 300 MB of memory.
        Failures are those of the launches. What is left when the program ends is not built.
        """
        programs = list(programs)
        child = self._start_compiler(programs)

        def build() -> None:
            for file, defines in programs:
                _await_compiler(_storage_key(*self._key(file, defines)))
                if main_thread().is_alive():
                    with suppress(SketchterrainError):
                        self._build(file, defines)
            if child is not None:
                child.kill()
                child.wait()

        Thread(target=build, name="programs").start()

    def launch(
        self,
        file: str,
        kernel: str,
        size: Sequence[int],
        *arguments: object,
        group: Sequence[int] | None = None,
        defines: Defines = (),
    ) -> Any:
        """Enqueue one kernel with global and local work sizes; builds its file with macros before.

        Returns the event, which knows its times on the device (``event.profile``, ns). Arguments are buffers
        and NumPy scalars of the exact type, in the kernel's order.
        """
        shape = (tuple(size), None if group is None else tuple(group))
        work = self._kernel(file, kernel, defines)
        return self._call(f"launching {kernel}", work, self._queue, *shape, *arguments)

    def max_group_size(self, file: str, kernel: str, defines: Defines = ()) -> int:
        """Return the largest work-group size of a kernel on this device."""
        query = cl.kernel_work_group_info.WORK_GROUP_SIZE
        info = self._kernel(file, kernel, defines).get_work_group_info
        return int(self._call("querying the work-group size", info, query, self.device.handle))

    def upload(self, array: npt.NDArray[Any], *, writable: bool = False) -> Any:
        """Copy an array to a new device buffer; an empty array gets a buffer of one element."""
        host = np.ascontiguousarray(array)
        if host.nbytes == 0:
            host = np.zeros(1, dtype=host.dtype)
        access = cl.mem_flags.READ_WRITE if writable else cl.mem_flags.READ_ONLY
        flags = access | cl.mem_flags.COPY_HOST_PTR
        return self._call("uploading", cl.Buffer, self._context, flags, hostbuf=host)

    def empty(self, shape: Sequence[int] | int, dtype: npt.DTypeLike) -> Any:
        """Create an uninitialised device buffer for an array of this shape."""
        nbytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
        return self._call("a buffer", cl.Buffer, self._context, cl.mem_flags.READ_WRITE, max(nbytes, 1))

    def wrap_host_memory(self, host: npt.NDArray[np.uint8]) -> Any:
        """Return host memory as a buffer; a CPU device writes it in place. See :meth:`synchronize_host`."""
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
        return self._call("a buffer", cl.Buffer, self._context, flags, hostbuf=host)

    def synchronize_host(self, buffer: Any, parts: Sequence[tuple[int, int]]) -> None:
        """Wait for the queue and make ranges (start, bytes) of wrapped host memory visible to the host."""
        for start, size in parts:
            self._call("mapping", self._map_range, buffer, start, size)
        self._call("finishing", self._queue.finish)

    def _map_range(self, buffer: Any, start: int, size: int) -> None:
        flags = cl.map_flags.READ
        mapped, _ = cl.enqueue_map_buffer(self._queue, buffer, flags, start, (size,), np.uint8)
        mapped.base.release(self._queue)

    def from_gl(self, name: int) -> Any:
        """Return an OpenGL buffer, by name, as a buffer of this context, which must share with OpenGL."""
        return self._call("a buffer", gl_interop.wrap_gl_buffer, self.device, self._context, name)

    def acquire_gl(self, buffer: Any) -> None:
        """Enqueue acquiring a shared OpenGL buffer; OpenGL must have finished with it."""
        self._call("acquiring", gl_interop.acquire, self.device, self._queue, buffer)

    def release_gl(self, buffer: Any) -> None:
        """Release a shared buffer to OpenGL and wait for the queue."""
        self._call("releasing", gl_interop.release, self.device, self._queue, buffer)
        self._call("finishing", self._queue.finish)

    def sub_buffer(self, buffer: Any, start: int, size: int) -> Any:
        """Return `size` bytes of a buffer as a sub-buffer; `start` must be aligned as the device requires."""
        return self._call("a buffer", buffer.get_sub_region, start, size)

    def write(self, buffer: Any, array: npt.NDArray[Any]) -> Any:
        """Enqueue a copy of a contiguous array to the start of a buffer; return the event."""
        return self._call("uploading", cl.enqueue_copy, self._queue, buffer, array, is_blocking=False)

    def upload_into(self, buffer: Any, array: npt.NDArray[Any], *, start: int) -> None:
        """Copy a contiguous array into a buffer at a byte offset, and wait for it."""
        if array.nbytes:
            self._call("uploading", cl.enqueue_copy, self._queue, buffer, array, dst_offset=start)

    def wait(self, event: Any, *, action: str = "uploading") -> None:
        """Wait for an event of `write` or `read`; `action` names it in the error message."""
        self._call(action, event.wait)

    def download(self, buffer: Any, shape: Sequence[int] | int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Wait for the queue and copy a buffer into a new array."""
        array = np.empty(shape, dtype=dtype)
        self.download_into(buffer, array)
        return array

    def download_into(self, buffer: Any, array: npt.NDArray[Any], *, start: int = 0) -> None:
        """Wait for the queue and copy a buffer, from a byte offset, into a contiguous array."""
        if array.nbytes:
            self._call("downloading", cl.enqueue_copy, self._queue, array, buffer, src_offset=start)

    def read(self, buffer: Any, array: npt.NDArray[Any]) -> Any:
        """Enqueue a copy of the start of a buffer into a contiguous array; return the event."""
        event = self._call("downloading", cl.enqueue_copy, self._queue, array, buffer, is_blocking=False)
        self._call("downloading", self._queue.flush)
        return event

    def _kernel(self, file: str, name: str, defines: Defines) -> Any:
        key = file, name, defines
        if key not in self._kernels:
            for kernel in self._call("building", self._build(file, defines).all_kernels):
                self._kernels[file, kernel.function_name, defines] = kernel
        if key not in self._kernels:
            # PoCL's cache may return a program without kernels.
            where = f"{self.device.name} ({self.device.platform} {self.device.driver})"
            raise BuildError(f"kernels/{file} was built on {where} without its kernel {name}")
        return self._kernels[key]

    def _start_compiler(self, programs: Sequence[tuple[str, Defines]]) -> subprocess.Popen[bytes] | None:
        """Start a process that compiles the programs that are to be stored and are not yet, if any."""
        if has_src_build_cache(self.device.handle):
            return None
        keys = [_storage_key(*self._key(*program)) for program in programs]
        missing = [
            number
            for number, key in enumerate(keys)
            if key not in _COMPILERS and not is_cached("program", key)
        ]
        if not missing:
            return None
        index = (self.device.twin_of or self.device).index
        request = [index, self.real, self.fast, [programs[number] for number in missing]]
        command = module_command("sketchterrain.compute.context", json.dumps(request))
        null = subprocess.DEVNULL
        try:
            child = subprocess.Popen(command, stdin=null, stdout=null, stderr=null)  # noqa: S603
        except OSError:  # no memory or no right to start one: launches compile
            return None
        _COMPILERS.update({keys[number]: child for number in missing})
        return child

    def _key(self, file: str, defines: Defines) -> tuple[Any, str, tuple[str, ...]]:
        """Return context, source and options of a program."""
        options = (*_OPTIONS, f"-DREAL={self.real}", *(_FAST_OPTIONS if self.fast else ()))
        return self._context, resources.source(file, defines), options

    def _build(self, file: str, defines: Defines) -> Any:
        key = self._key(file, defines)
        try:
            with _BUILDING.setdefault(key, Lock()):
                return _built(*key)
        except cl.Error as error:
            raise build_error(self.device, file, key[2], error) from error

    def _call(self, action: str, work: Callable[..., T], *given: Any, **named: Any) -> T:
        """Make one OpenCL call; all but builds pass here, so that failures are raised alike."""
        try:
            return work(*given, **named)
        except cl.Error as error:
            raise call_error(self.device, action, error) from error


@cache
def _opened(device: Device, gl: GLHandles | None) -> Any:
    """Return a device's context, one per process, so that its programs stay built."""
    return cl.Context([device.handle]) if gl is None else gl_interop.open_shared_context(device, gl)


@cache
def _built(context: Any, source: str, options: tuple[str, ...]) -> Any:
    """Return a program, from the stored binary of an earlier build where the driver stores none itself."""
    (device,) = context.devices
    if has_src_build_cache(device):
        return _build(cl.Program(context, source), options)
    built: list[Any] = []
    storage_key = _storage_key(context, source, options)
    _await_compiler(storage_key)

    def compile_source() -> bytes:
        built.append(_build(cl.Program(context, source), options))
        return bytes(built[0].get_info(cl.program_info.BINARIES)[0])

    binary = cached_bytes("program", storage_key, compile_source, max_bytes=_MAX_BINARIES)
    if not built:
        try:
            return _build(cl.Program(context, [device], [bytes(binary)]), options)
        except cl.Error:  # of another processor, or of a driver that does not read its own
            compile_source()
    return built[0]


def _await_compiler(storage_key: str) -> None:
    """Wait while a child process compiles a program, unless this process ends."""
    child = _COMPILERS.get(storage_key)
    while (
        child and child.poll() is None and not is_cached("program", storage_key) and main_thread().is_alive()
    ):
        time.sleep(_POLL)


def _storage_key(context: Any, source: str, options: tuple[str, ...]) -> str:
    """Return what a stored binary depends on."""
    (device,) = context.devices
    platform, processor = device.platform, np.show_config(mode="dicts")["SIMD Extensions"]
    driver = platform.name, platform.version, device.name, device.version, device.driver_version, processor
    return repr((driver, options, source))


def _build(program: Any, options: tuple[str, ...]) -> Any:
    # pyopencl's cache fails on a refused binary, and for a minute on the lock of a process that was killed.
    return program.build(options=list(options), cache_dir=False)


if __name__ == "__main__":
    index, real, fast, requested = json.loads(sys.argv[1])
    own = ComputeContext(list_devices()[index], real=real, fast=fast)
    for file, defines in requested:
        with suppress(SketchterrainError):
            own._build(file, tuple(map(tuple, defines)))
