"""Vertex buffers that OpenCL writes: shared, mapped or copied."""

from __future__ import annotations

import ctypes
from contextlib import contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from sketchterrain.compute.sharing import CopiedMemory, ExtensionMemory, MappedMemory, sharing_methods
from sketchterrain.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import moderngl
    import numpy.typing as npt

    from sketchterrain.compute.context import ComputeContext


COMMAND: Final = np.dtype(
    [
        ("count", "<u4"),
        ("instances", "<u4"),
        ("first", "<u4"),
        ("base_vertex", "<i4"),
        ("base_instance", "<u4"),
    ]
)
"""One draw of indexed vertices in a buffer of commands: DrawElementsIndirectCommand."""

_LIBRARIES: Final = ("libOpenGL.so.0", "libGL.so.1", "opengl32")
_ASKED: Final = (("libEGL.so.1", "eglGetProcAddress"), ("opengl32", "wglGetProcAddress"))

_COMPLETE, _FLUSH = 0x9117, 0x1  # GL_SYNC_GPU_COMMANDS_COMPLETE, GL_SYNC_FLUSH_COMMANDS_BIT
_TIMEOUT_EXPIRED, _WAIT_FAILED = 0x911B, 0x911D
_TURN: Final = 1_000_000_000  # ns
_CLIP_DISTANCES: Final = range(0x3000, 0x3004)  # GL_CLIP_DISTANCE0 …


@cache
def gl_function(name: str, result: Any, *arguments: Any) -> Any:
    """Return a function of OpenGL, with the ctypes of its result and arguments."""
    for library in _LIBRARIES:
        with suppress(OSError, AttributeError):
            function = getattr(ctypes.CDLL(library), name)
            function.restype, function.argtypes = result, arguments
            return function
    for library, asked in _ASKED:
        with suppress(OSError, AttributeError):
            ask = getattr(ctypes.CDLL(library), asked)
            ask.restype, ask.argtypes = ctypes.c_void_p, (ctypes.c_char_p,)
            address = ask(name.encode())
            if address:
                return ctypes.CFUNCTYPE(result, *arguments)(address)
    raise DeviceError(f"this machine's OpenGL has no {name}")


def wait_for_gl() -> None:
    """Wait until OpenGL has finished with all that it was told so far."""
    fence = gl_function("glFenceSync", ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint)(_COMPLETE, 0)
    wait = gl_function("glClientWaitSync", ctypes.c_uint, ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint64)
    if not fence:
        raise DeviceError("OpenGL gave no fence to wait for")
    try:
        found = _TIMEOUT_EXPIRED
        while found == _TIMEOUT_EXPIRED:
            found = wait(fence, _FLUSH, _TURN)
    finally:
        gl_function("glDeleteSync", None, ctypes.c_void_p)(fence)
    if found == _WAIT_FAILED:
        raise DeviceError("OpenGL failed while it was waited for")


@contextmanager
def clipping(context: moderngl.Context) -> Iterator[None]:
    """Cut off what the four ``gl_ClipDistance`` of vertex shaders say, while this lasts."""
    for distance in _CLIP_DISTANCES:
        context.enable_direct(distance)
    try:
        yield
    finally:
        for distance in _CLIP_DISTANCES:
            context.disable_direct(distance)


_TARGET: Final = 0x8F37  # GL_COPY_WRITE_BUFFER: no one else's binding is disturbed
_READ, _WRITE, _PERSISTENT, _COHERENT = 0x1, 0x2, 0x40, 0x80
_STORAGE_VERSION: Final = 440
_STORAGE_EXTENSION: Final = "GL_ARB_buffer_storage"


class _Written(Protocol):
    """One of the kinds in :mod:`sketchterrain.compute.sharing`."""

    nbytes: int
    buffer: Any

    def acquire(self) -> None: ...

    def release(self, parts: Sequence[tuple[int, int]]) -> None: ...

    def close(self) -> None: ...


class GLVertexMemory:
    """Bytes that a device writes and OpenGL draws from; a ``memory`` for ``Terrain.vertex_store``.

    All calls belong to the thread in which the OpenGL context is current.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        kind: str,
        vertices: moderngl.Buffer,
        written: _Written,
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
        """How much it is."""
        return self._written.nbytes

    @property
    def buffer(self) -> Any:
        """The device's buffer."""
        return self._written.buffer

    def acquire(self) -> None:
        """Make it the device's, once OpenGL has finished with what it was told to draw."""
        if self.kind != "copy":  # which OpenGL itself puts in order
            wait_for_gl()
        self._written.acquire()

    def release(self, parts: Sequence[tuple[int, int]]) -> None:
        """Wait for the device and make what it wrote, parts (start, size in bytes), visible to OpenGL."""
        self._written.release(parts)

    def read(self) -> bytes:
        """Return what OpenGL sees; moderngl's own way refuses a buffer that is mapped."""
        beside = self._gl.buffer(reserve=self.nbytes)
        try:
            self._gl.copy_buffer(beside, self.vertices, self.nbytes)
            return beside.read()
        finally:
            beside.release()

    def close(self) -> None:
        """Give the memory back; nothing may draw from it or write to it any more."""
        self._written.close()
        self.vertices.release()
        if self.kind == "mapped":  # moderngl leaves alone what it did not make
            name = ctypes.c_uint(self._name)
            gl_function("glDeleteBuffers", None, ctypes.c_int, ctypes.POINTER(ctypes.c_uint))(1, name)


def open_vertex_memory(
    gl: moderngl.Context, context: ComputeContext, nbytes: int, *, kind: str | None = None
) -> GLVertexMemory:
    """Make a buffer for vertices that a device's kernels write."""
    ways = {"extension": _by_extension, "mapped": _mapped, "copy": _copied}
    reasons: list[str] = []
    for each in (kind,) if kind is not None else sharing_methods(context):
        try:
            vertices, written = ways[each](gl, context, nbytes)
        except DeviceError as error:
            if each == kind or each == "copy":
                raise
            reasons.append(str(error))
        else:
            return GLVertexMemory(gl, each, vertices, written, reason="; ".join(reasons))
    raise DeviceError("no kind of memory is left")


def _by_extension(
    gl: moderngl.Context, context: ComputeContext, nbytes: int
) -> tuple[moderngl.Buffer, _Written]:
    if context.gl is None:
        raise DeviceError(f"{context.device.name} was not opened beside an OpenGL context")
    vertices = gl.buffer(reserve=nbytes, dynamic=True)
    wait_for_gl()
    try:
        return vertices, ExtensionMemory(context, vertices.glo, nbytes)
    except DeviceError:
        vertices.release()
        raise


def _mapped(gl: moderngl.Context, context: ComputeContext, nbytes: int) -> tuple[moderngl.Buffer, _Written]:
    if context.device.type != "CPU":
        raise DeviceError(f"{context.device.name} is no CPU: it can't write where OpenGL maps a buffer")
    if gl.version_code < _STORAGE_VERSION and _STORAGE_EXTENSION not in gl.extensions:
        raise DeviceError(f"this machine's OpenGL has no {_STORAGE_EXTENSION}")
    unsigned, size, address = ctypes.c_uint, ctypes.c_ssize_t, ctypes.c_void_p
    name = unsigned()
    gl_function("glGenBuffers", None, ctypes.c_int, ctypes.POINTER(unsigned))(1, name)
    bind = gl_function("glBindBuffer", None, unsigned, unsigned)
    storage = gl_function("glBufferStorage", None, unsigned, size, address, unsigned)
    map_range = gl_function("glMapBufferRange", address, unsigned, size, size, unsigned)
    flags = _READ | _WRITE | _PERSISTENT | _COHERENT
    bind(_TARGET, name.value)
    storage(_TARGET, nbytes, None, flags)
    place = map_range(_TARGET, 0, nbytes, flags)
    bind(_TARGET, 0)
    if not place:
        gl_function("glDeleteBuffers", None, ctypes.c_int, ctypes.POINTER(unsigned))(1, name)
        raise DeviceError(f"OpenGL maps no buffer of {nbytes} bytes for good ({gl.error})")
    host = np.ctypeslib.as_array(ctypes.cast(place, ctypes.POINTER(ctypes.c_uint8)), (nbytes,))
    return gl.external_buffer(name.value, nbytes), MappedMemory(context, host)


def _copied(gl: moderngl.Context, context: ComputeContext, nbytes: int) -> tuple[moderngl.Buffer, _Written]:
    vertices = gl.buffer(reserve=nbytes, dynamic=True)

    def write(start: int, part: npt.NDArray[np.uint8]) -> None:
        vertices.write(part, offset=start)

    return vertices, CopiedMemory(context, nbytes, write)
