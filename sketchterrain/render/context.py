"""OpenGL without a window."""

from __future__ import annotations

from typing import Any

import moderngl

from sketchterrain.errors import DeviceError

VERSION = 430
"""OpenGL 4.3 core: the ground is drawn by one indirect multi-draw."""


def open_context() -> moderngl.Context:
    """Open a standalone OpenGL context through EGL, which needs no screen.

    Raises
    ------
    DeviceError
        If this machine has no OpenGL of the needed version; one line says what to install.
    """
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
    """Close a context and all that was made in it.

    Buffers and textures that are still referred to go later; they must not delete by number then, for another
    context that is current would lose its own of the same numbers.
    """
    context.gc_mode = None  # type: ignore[assignment]  # as its documentation says
    context.release()


def release_orphans(context: moderngl.Context) -> None:
    """Delete what died in a context whose ``gc_mode`` is ``context_gc``; what was given back before is left.

    moderngl's own way fails at the latter.
    """
    while context.objects:
        dead = context.objects.popleft()
        if hasattr(dead, "release"):
            dead.release()
