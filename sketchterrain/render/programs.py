"""OpenGL contexts without a window, shader programs, and a cache of OpenGL resources."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from itertools import count
from typing import Any, TypeAlias, TypeVar

import moderngl

from sketchterrain.errors import BuildError, DeviceError
from sketchterrain.io.resources import source

T = TypeVar("T")


VERSION = 430  # OpenGL 4.3 core, for indirect multi-draw


def open_context() -> moderngl.Context:
    """Open an OpenGL context through EGL, without a screen; raise DeviceError with installation advice."""
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


class ResourceCache:
    """One resource of each kind of one OpenGL context: material textures, vertex memory.

    A resource may be used until another one of its kind is requested. The creator of the cache closes it;
    others get it by `borrow`.
    """

    def __init__(self) -> None:
        self._entries: dict[str, tuple[Hashable, object, Callable[[], None] | None]] = {}
        self._is_borrowed = False

    def borrow(self) -> ResourceCache:
        """Return a view of the same entries whose `close` has no effect."""
        other = ResourceCache()
        other._entries, other._is_borrowed = self._entries, True
        return other

    def get_or_create(
        self, kind: str, key: Hashable, create: Callable[[], T], *, close: Callable[[T], None] | None = None
    ) -> T:
        """Return the cached resource of a kind; replace one that was created for another key."""
        entry = self._entries.get(kind)
        if entry is not None and entry[0] == key:
            resource: T = entry[1]  # type: ignore[assignment]  # a kind has one type
            return resource
        self._remove(kind)
        created = create()
        self._entries[kind] = key, created, None if close is None else lambda: close(created)
        return created

    def close(self) -> None:
        """Release all resources unless borrowed."""
        if not self._is_borrowed:
            for kind in list(self._entries):
                self._remove(kind)

    def _remove(self, kind: str) -> None:
        _, _, close = self._entries.pop(kind, (None, None, None))
        if close is not None:
            close()


FRAME_BINDING = 0  # binding point of the uniform block ``Frame`` (kernels/render/frame.glsl)


def build_program(
    context: moderngl.Context,
    vertex: str,
    fragment: str | None = None,
    *,
    captured: Sequence[str] = (),
    defines: Mapping[str, int | str] | None = None,
) -> moderngl.Program:
    """Build a program from files in ``kernels/render``, with macros; raise BuildError.

    One without a fragment shader captures outputs of its vertex shader by transform feedback.
    """
    macros = tuple((defines or {}).items())
    try:
        program = context.program(
            vertex_shader=source(f"render/{vertex}", macros),
            fragment_shader=None if fragment is None else source(f"render/{fragment}", macros),
            varyings=tuple(captured),
        )
    except moderngl.Error as error:
        names, log = " and ".join(filter(None, (vertex, fragment))), " ".join(str(error).split())
        raise BuildError(f"GLSL program of {names} did not build: {log}") from error
    block = program.get("Frame", None)
    if isinstance(block, moderngl.UniformBlock):
        block.binding = FRAME_BINDING
    return program


def set_uniforms(program: moderngl.Program, values: Mapping[str, object]) -> None:
    """Set the active uniforms: compilers remove unused ones and the unused end of arrays."""
    for name, value in values.items():
        member = program.get(name, None)
        if isinstance(member, moderngl.Uniform):
            many = member.array_length
            if isinstance(value, list):
                member.value = value[:many] if many > 1 else value[0]
            else:
                member.value = value


Textures: TypeAlias = moderngl.Texture | moderngl.TextureArray | moderngl.Texture3D | list[moderngl.Texture]
"""What a sampler, or an array of samplers, reads."""


def bind_textures(textures: Mapping[str, Textures]) -> dict[str, object]:
    """Bind textures to units of their own, from 1 on; return the units by the names of the samplers."""
    unit = count(1)
    units: dict[str, object] = {}
    for name, given in textures.items():
        numbers = [next(unit) for _ in (given if isinstance(given, list) else [given])]
        for number, texture in zip(numbers, given if isinstance(given, list) else [given], strict=True):
            texture.use(number)
        units[name] = numbers if isinstance(given, list) else numbers[0]
    return units


Clamped = TypeVar("Clamped", moderngl.Texture, moderngl.TextureArray)


def clamped(texture: Clamped) -> Clamped:
    """Return a texture that does not repeat beyond its borders."""
    texture.repeat_x = texture.repeat_y = False
    return texture


def mipmapped(texture: moderngl.Texture) -> moderngl.Texture:
    """Build a texture's mipmaps, and return it, filtered trilinearly."""
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return texture


def fullscreen_pass(
    context: moderngl.Context, fragment: str, *, defines: Mapping[str, int | str] | None = None
) -> moderngl.VertexArray:
    """Return a full-screen pass of a fragment shader, for ``.render(vertices=3)``."""
    return context.vertex_array(build_program(context, "screen.vert.glsl", fragment, defines=defines), [])
