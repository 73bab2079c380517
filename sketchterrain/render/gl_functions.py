"""What of OpenGL moderngl has no words for: functions, called on the context that is current; a record."""

from __future__ import annotations

import ctypes
from contextlib import contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Iterator

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
