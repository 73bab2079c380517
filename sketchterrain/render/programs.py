"""Shader programs, and a cache of OpenGL resources."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import TypeVar

import moderngl

from sketchterrain.errors import BuildError
from sketchterrain.io.resources import source

T = TypeVar("T")


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


FRAME_BINDING = 0
"""Binding point of the uniform block ``Frame`` (kernels/render/frame.glsl)."""


def build_program(
    context: moderngl.Context, vertex: str, fragment: str, *, defines: Mapping[str, int] | None = None
) -> moderngl.Program:
    """Build a program from two files relative to ``kernels/render``."""
    try:
        program = context.program(
            vertex_shader=_with_defines(source(f"render/{vertex}"), defines),
            fragment_shader=_with_defines(source(f"render/{fragment}"), defines),
        )
    except moderngl.Error as error:
        log = " ".join(str(error).split())
        raise BuildError(f"GLSL program of {vertex} and {fragment} did not build: {log}") from error
    return _with_frame(program)


def build_transform(
    context: moderngl.Context,
    vertex: str,
    captured: Sequence[str],
    *,
    defines: Mapping[str, int] | None = None,
) -> moderngl.Program:
    """Build a program that draws nothing: what its vertex shader computes is captured."""
    try:
        program = context.program(
            vertex_shader=_with_defines(source(f"render/{vertex}"), defines), varyings=tuple(captured)
        )
    except moderngl.Error as error:
        raise BuildError(f"GLSL program of {vertex} did not build: {' '.join(str(error).split())}") from error
    return _with_frame(program)


def _with_frame(program: moderngl.Program) -> moderngl.Program:
    if "Frame" in program:
        block = program["Frame"]
        if isinstance(block, moderngl.UniformBlock):
            block.binding = FRAME_BINDING
    return program


def set_uniforms(program: moderngl.Program, values: Mapping[str, object]) -> None:
    """Set those uniforms that the program has: compilers drop what it does not use, of an array the end."""
    for name, value in values.items():
        member = program.get(name, None)
        if isinstance(member, moderngl.Uniform):
            many = member.array_length
            if isinstance(value, list) and len(value) > many:
                member.value = value[:many] if many > 1 else value[0]
            else:
                member.value = value


def fullscreen_pass(
    context: moderngl.Context, fragment: str, *, defines: Mapping[str, int] | None = None
) -> moderngl.VertexArray:
    """Make a pass that runs a fragment shader over the whole framebuffer: ``.render(vertices=3)``."""
    return context.vertex_array(build_program(context, "screen.vert.glsl", fragment, defines=defines), [])


def _with_defines(text: str, defines: Mapping[str, int] | None) -> str:
    version, _, rest = text.partition("\n")
    macros = "".join(f"#define {name} {value}\n" for name, value in (defines or {}).items())
    return f"{version}\n{macros}#line 2\n{rest}"
