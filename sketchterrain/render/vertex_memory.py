"""Vertex buffers that OpenCL writes: shared, mapped or copied."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.compute.buffers import CopiedMemory, ExtensionMemory, MappedMemory, sharing_methods
from sketchterrain.compute.context import ComputeContext
from sketchterrain.errors import DeviceError

if TYPE_CHECKING:
    import moderngl


COMMAND: Final = np.dtype(
    [
        ("count", "<u4"),
        ("instances", "<u4"),
        ("first", "<u4"),
        ("base_vertex", "<i4"),
        ("base_instance", "<u4"),
    ]
)
"""DrawElementsIndirectCommand."""

_LIBRARIES: Final = ("libOpenGL.so.0", "libGL.so.1", "opengl32")
_ADDRESS_FUNCTIONS: Final = (("libEGL.so.1", "eglGetProcAddress"), ("opengl32", "wglGetProcAddress"))

_COMPLETE, _FLUSH = 0x9117, 0x1  # GL_SYNC_GPU_COMMANDS_COMPLETE, GL_SYNC_FLUSH_COMMANDS_BIT
_TIMEOUT_EXPIRED, _WAIT_FAILED = 0x911B, 0x911D
_WAIT_STEP: Final = 1_000_000_000  # ns
_CLIP_DISTANCES: Final = range(0x3000, 0x3004)  # GL_CLIP_DISTANCE0 …


@cache
def gl_function(name: str, result: Any, *arguments: Any) -> Any:
    """Return an OpenGL function with ctypes of its result and arguments; raise DeviceError if missing."""
    for library in _LIBRARIES:
        with suppress(OSError, AttributeError):
            function = getattr(ctypes.CDLL(library), name)
            function.restype, function.argtypes = result, arguments
            return function
    for library, function_name in _ADDRESS_FUNCTIONS:
        with suppress(OSError, AttributeError):
            get_address = getattr(ctypes.CDLL(library), function_name)
            get_address.restype, get_address.argtypes = ctypes.c_void_p, (ctypes.c_char_p,)
            address = get_address(name.encode())
            if address:
                return ctypes.CFUNCTYPE(result, *arguments)(address)
    raise DeviceError(f"this machine's OpenGL has no {name}")


def wait_for_gl() -> None:
    """Wait until OpenGL has finished all issued commands."""
    fence = gl_function("glFenceSync", ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint)(_COMPLETE, 0)
    wait = gl_function("glClientWaitSync", ctypes.c_uint, ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint64)
    if not fence:
        raise DeviceError("OpenGL returned no fence")
    try:
        status = _TIMEOUT_EXPIRED
        while status == _TIMEOUT_EXPIRED:
            status = wait(fence, _FLUSH, _WAIT_STEP)
    finally:
        gl_function("glDeleteSync", None, ctypes.c_void_p)(fence)
    if status == _WAIT_FAILED:
        raise DeviceError("waiting for OpenGL failed")


@contextmanager
def clipping(context: moderngl.Context) -> Iterator[None]:
    """Enable the four ``gl_ClipDistance`` of vertex shaders."""
    for distance in _CLIP_DISTANCES:
        context.enable_direct(distance)
    try:
        yield
    finally:
        for distance in _CLIP_DISTANCES:
            context.disable_direct(distance)


_TARGET: Final = 0x8F37  # GL_COPY_WRITE_BUFFER: no other binding is disturbed
_READ, _WRITE, _PERSISTENT, _COHERENT = 0x1, 0x2, 0x40, 0x80
_STORAGE_VERSION: Final = 440
_STORAGE_EXTENSION: Final = "GL_ARB_buffer_storage"
_PINNED_EXTENSION: Final = "GL_AMD_pinned_memory"
_PINNED, _STREAM_DRAW = 0x9160, 0x88E0  # GL_EXTERNAL_VIRTUAL_MEMORY_BUFFER_AMD
_PAGE: Final = 4096


_DeviceMemory: TypeAlias = CopiedMemory | ExtensionMemory | MappedMemory


class GLVertexMemory:
    """Memory that a device writes and OpenGL draws from; a ``memory`` for ``Terrain.vertex_store``.

    Use it in the thread of the OpenGL context. `reason` is why `kind` is not a better one.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        kind: str,
        vertices: moderngl.Buffer,
        written: _DeviceMemory,
        *,
        reason: str = "",
    ) -> None:
        self._gl = gl
        self.kind = kind
        self.vertices = vertices
        self.reason = reason
        self._written = written
        self._name = vertices.glo

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return self._written.nbytes

    @property
    def buffer(self) -> Any:
        """The device's buffer."""
        return self._written.buffer

    def acquire(self) -> None:
        """Hand the memory to the device after OpenGL has finished drawing."""
        if self.kind != "copy":  # OpenGL orders copies itself
            wait_for_gl()
        self._written.acquire()

    def release(self, parts: Sequence[tuple[int, int]]) -> None:
        """Wait for the device and make written parts (start, size; bytes) visible to OpenGL."""
        self._written.release(parts)

    def read(self) -> bytes:
        """Return OpenGL's content; moderngl's own ``read`` rejects mapped buffers."""
        beside = self._gl.buffer(reserve=self.nbytes)
        try:
            self._gl.copy_buffer(beside, self.vertices, self.nbytes)
            return beside.read()
        finally:
            beside.release()

    def close(self) -> None:
        """Release the memory."""
        self._gl.finish()  # drawing may still read memory that is freed here
        self._written.close()
        self.vertices.release()
        if self.kind == "mapped":  # moderngl does not delete external buffers
            name = ctypes.c_uint(self._name)
            gl_function("glDeleteBuffers", None, ctypes.c_int, ctypes.POINTER(ctypes.c_uint))(1, name)


def open_vertex_memory(
    gl: moderngl.Context, context: ComputeContext, nbytes: int, *, kind: str | None = None
) -> GLVertexMemory:
    """Allocate vertex memory of a sharing method, or of the best one that works; raise DeviceError."""
    allocators = {"extension": _by_extension, "mapped": _mapped, "copy": _copied}
    reasons: list[str] = []
    for method in (kind,) if kind is not None else sharing_methods(context):
        try:
            vertices, written = allocators[method](gl, context, nbytes)
        except DeviceError as error:
            if method == kind or method == "copy":
                raise
            reasons.append(str(error))
        else:
            return GLVertexMemory(gl, method, vertices, written, reason="; ".join(reasons))
    raise DeviceError("no sharing method works")


def _by_extension(
    gl: moderngl.Context, context: ComputeContext, nbytes: int
) -> tuple[moderngl.Buffer, _DeviceMemory]:
    if context.gl is None:
        raise DeviceError(f"{context.device.name} was not opened with an OpenGL context")
    vertices = gl.buffer(reserve=nbytes, dynamic=True)
    wait_for_gl()
    try:
        return vertices, ExtensionMemory(context, vertices.glo, nbytes)
    except DeviceError:
        vertices.release()
        raise


def _mapped(
    gl: moderngl.Context, context: ComputeContext, nbytes: int
) -> tuple[moderngl.Buffer, _DeviceMemory]:
    if context.device.type != "CPU":
        raise DeviceError(f"{context.device.name} is not a CPU and cannot write mapped OpenGL buffers")
    if gl.version_code < _STORAGE_VERSION and _STORAGE_EXTENSION not in gl.extensions:
        raise DeviceError(f"this machine's OpenGL has no {_STORAGE_EXTENSION}")
    unsigned, size, address = ctypes.c_uint, ctypes.c_ssize_t, ctypes.c_void_p
    name = unsigned()
    gl_function("glGenBuffers", None, ctypes.c_int, ctypes.POINTER(unsigned))(1, name)
    bind = gl_function("glBindBuffer", None, unsigned, unsigned)
    if _PINNED_EXTENSION in gl.extensions:  # memory of its own Mesa clears, so that all of it is resident
        host = np.empty(nbytes + _PAGE, np.uint8)
        host = host[-host.ctypes.data % _PAGE :][:nbytes]
        bind(_PINNED, name.value)
        allocate = gl_function("glBufferData", None, unsigned, size, address, unsigned)
        allocate(_PINNED, nbytes, host.ctypes.data, _STREAM_DRAW)
        bind(_PINNED, 0)
        return gl.external_buffer(name.value, nbytes), MappedMemory(context, host)
    storage = gl_function("glBufferStorage", None, unsigned, size, address, unsigned)
    map_range = gl_function("glMapBufferRange", address, unsigned, size, size, unsigned)
    flags = _READ | _WRITE | _PERSISTENT | _COHERENT
    bind(_TARGET, name.value)
    storage(_TARGET, nbytes, None, flags)
    mapped = map_range(_TARGET, 0, nbytes, flags)
    bind(_TARGET, 0)
    if not mapped:
        gl_function("glDeleteBuffers", None, ctypes.c_int, ctypes.POINTER(unsigned))(1, name)
        raise DeviceError(f"OpenGL cannot map a persistent buffer of {nbytes} bytes ({gl.error})")
    host = np.ctypeslib.as_array(ctypes.cast(mapped, ctypes.POINTER(ctypes.c_uint8)), (nbytes,))
    return gl.external_buffer(name.value, nbytes), MappedMemory(context, host)


def _copied(
    gl: moderngl.Context, context: ComputeContext, nbytes: int
) -> tuple[moderngl.Buffer, _DeviceMemory]:
    vertices = gl.buffer(reserve=nbytes, dynamic=True)

    def write(start: int, part: npt.NDArray[np.uint8]) -> None:
        vertices.write(part, offset=start)

    return vertices, CopiedMemory(context, nbytes, write)
