"""OpenCL/OpenGL buffer sharing by ``cl_khr_gl_sharing``.

PyPI's pyopencl is built without the sharing calls (``cl.have_gl()`` is False), so they go through ctypes,
with the OpenCL library that pyopencl uses.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import pyopencl as cl

from sketchterrain.compute.device import Device
from sketchterrain.errors import DeviceError

# Names of properties in the order of cl.h, cl_gl.h.
_PLATFORM: Final = 0x1084
_GL_CONTEXT, _EGL_DISPLAY, _GLX_DISPLAY, _WGL_HDC = 0x2008, 0x2009, 0x200A, 0x200B
_SUCCESS: Final = 0
_EXTENSION: Final = "cl_khr_gl_sharing"


@dataclass(frozen=True)
class GLHandles:
    """Addresses of the current OpenGL context and its display; window system 'EGL', 'GLX' or 'WGL'."""

    window_system: str
    context: int
    display: int

    @property
    def properties(self) -> tuple[int, ...]:
        """Names and values for ``clCreateContext``."""
        name = {"EGL": _EGL_DISPLAY, "GLX": _GLX_DISPLAY, "WGL": _WGL_HDC}[self.window_system]
        return (_GL_CONTEXT, self.context, name, self.display)


def current_handles() -> GLHandles | None:
    """Return the OpenGL context that is current in this thread, None if not found."""
    methods = (
        ("EGL", "libEGL.so.1", "eglGetCurrentContext", "eglGetCurrentDisplay"),
        ("GLX", "libGL.so.1", "glXGetCurrentContext", "glXGetCurrentDisplay"),
        ("WGL", "opengl32", "wglGetCurrentContext", "wglGetCurrentDC"),
    )
    for window_system, library, *functions in methods:
        context, display = (_address(library, function) for function in functions)
        if context and display:
            return GLHandles(window_system, context, display)
    return None


def open_shared_context(device: Device, handles: GLHandles) -> Any:
    """Open a context that shares buffers with an OpenGL context; DeviceError if not supported."""
    if _EXTENSION not in device.handle.extensions.split():
        # Some drivers would create a context anyway, and crash at the first buffer.
        raise DeviceError(f"{device.name} ({device.platform}) shares no buffers with OpenGL: no {_EXTENSION}")
    values = (*handles.properties, _PLATFORM, device.handle.platform.int_ptr, 0)
    properties = (ctypes.c_ssize_t * len(values))(*values)
    devices = (ctypes.c_void_p * 1)(device.handle.int_ptr)
    handle = _created(device, "clCreateContext", properties, ctypes.c_uint32(1), devices, None, None)
    return cl.Context.from_int_ptr(handle, retain=False)


def wrap_gl_buffer(device: Device, context: Any, name: int) -> Any:
    """Return an OpenGL buffer, by name, as a buffer of a context opened by :func:`open_shared_context`."""
    flags, owner = ctypes.c_uint64(int(cl.mem_flags.READ_WRITE)), ctypes.c_void_p(context.int_ptr)
    handle = _created(device, "clCreateFromGLBuffer", owner, flags, ctypes.c_uint32(name))
    return cl.Buffer.from_int_ptr(handle, retain=False)


def acquire(device: Device, queue: Any, buffer: Any) -> None:
    """Enqueue acquiring a shared buffer for OpenCL; OpenGL must have finished with it."""
    _transfer_ownership(device, "clEnqueueAcquireGLObjects", queue, buffer)


def release(device: Device, queue: Any, buffer: Any) -> None:
    """Enqueue releasing it to OpenGL; finish the queue before OpenGL reads it."""
    _transfer_ownership(device, "clEnqueueReleaseGLObjects", queue, buffer)


def _transfer_ownership(device: Device, name: str, queue: Any, buffer: Any) -> None:
    buffers = (ctypes.c_void_p * 1)(buffer.int_ptr)
    function = _function(name, ctypes.c_int32)
    status = function(
        ctypes.c_void_p(queue.int_ptr), ctypes.c_uint32(1), buffers, ctypes.c_uint32(0), None, None
    )
    _check(device, name, status)


def _created(device: Device, name: str, *arguments: Any) -> Any:
    """Return what a library function creates, whose last argument is the status."""
    status = ctypes.c_int32()
    handle = _function(name, ctypes.c_void_p)(*arguments, ctypes.byref(status))
    _check(device, name, status.value)
    return handle


def _check(device: Device, name: str, status: int) -> None:
    if status != _SUCCESS:
        message = cl.status_code.to_string(status, "error %d")
        raise DeviceError(
            f"{device.name} ({device.platform}) shares no buffers with OpenGL: {name}: {message}"
        )


def _function(name: str, result: Any) -> Any:
    function = getattr(_library(), name)
    function.restype = result
    return function


@cache
def _library() -> ctypes.CDLL:
    """Return the OpenCL library that pyopencl has loaded, not another one of the system."""
    maps = Path("/proc/self/maps")
    if maps.exists():
        for line in maps.read_text(encoding="utf-8").splitlines():
            path = Path(line.split(maxsplit=5)[-1])
            if path.name.startswith("libOpenCL"):
                return ctypes.CDLL(str(path))
    raise DeviceError("the OpenCL library in use can't be found, so no buffers are shared with OpenGL")


def _address(library: str, function: str) -> int:
    """Return the result of a library function without arguments, 0 if the library or function is missing."""
    try:  # Mesa's rusticl looks EGL and GLX up by dlsym among global symbols
        found = getattr(ctypes.CDLL(library, ctypes.RTLD_GLOBAL), function)
    except (OSError, AttributeError):
        return 0
    found.restype = ctypes.c_void_p
    return found() or 0
