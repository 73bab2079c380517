"""Standalone OpenGL contexts."""

from __future__ import annotations

from typing import Any

import moderngl

from sketchterrain.errors import DeviceError

VERSION = 430  # OpenGL 4.3 core, for indirect multi-draw


def open_context() -> moderngl.Context:
    """Open an OpenGL context through EGL, without a screen; raise DeviceError with what to install."""
    try:
        settings: dict[str, Any] = {"backend": "egl"}
        context = moderngl.create_context(require=VERSION, standalone=True, **settings)
    except Exception as error:
        raise DeviceError(
            f"no OpenGL 4.3 through EGL; on Debian or Ubuntu: apt install libegl1 libgl1-mesa-dri ({error})"
        ) from error
    context.gc_mode = "auto"
    return context


def close_context(context: moderngl.Context) -> None:
    """Close a context and all its objects.

    Buffers and textures that are still referenced are collected later. They must not be deleted by number
    then: the current context would lose its own object of that number.
    """
    context.gc_mode = None  # type: ignore[assignment]  # as its documentation says
    context.release()


def release_orphans(context: moderngl.Context) -> None:
    """Delete the collected objects of a context whose ``gc_mode`` is ``context_gc``.

    Objects that were already released are skipped; moderngl's own ``gc`` fails on them.
    """
    while context.objects:
        orphan = context.objects.popleft()
        if hasattr(orphan, "release"):
            orphan.release()
