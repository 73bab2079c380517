"""Build GLSL programs from the files in ``kernels/render``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import moderngl

from sketchterrain.errors import BuildError
from sketchterrain.resources import source

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
