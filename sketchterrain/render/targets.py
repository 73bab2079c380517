"""The framebuffers that a picture passes through."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import moderngl

__all__ = ["Targets"]


class Targets:
    """Framebuffers for pictures of one size.

    What is seen is found out at samples² samples a pixel and shaded at one; see spread.frag.glsl.

    Attributes
    ----------
    seen : moderngl.Framebuffer
        Depth, normal and material weights of the ground, at all samples.
    shaded, sky : moderngl.Framebuffer
        Radiance of the ground and of the sky, at one sample a pixel.
    spread : moderngl.Framebuffer
        Radiance at all samples, without depth.
    scene : moderngl.Framebuffer
        The same with depth, for what is drawn upon the ground.
    copy : moderngl.Framebuffer
        Holds a copy of the scene that water can look into.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int], samples: int) -> None:
        self.size = size
        inner = (size[0] * samples, size[1] * samples)
        self.inner = inner
        self.depth = _depth(context, inner)
        self.normal = _colour(context, inner, "f2")
        self.low_weights, self.high_weights = _colour(context, inner, "f1"), _colour(context, inner, "f1")
        self.seen = context.framebuffer([self.normal, self.low_weights, self.high_weights], self.depth)
        self.shaded_colour = _colour(context, size, "f4")
        self.shaded = context.framebuffer([self.shaded_colour])
        self.sky_colour = _colour(context, size, "f2")
        self.sky = context.framebuffer([self.sky_colour])
        self.colour = _colour(context, inner, "f2")
        self.spread = context.framebuffer([self.colour])
        self.scene = context.framebuffer([self.colour], self.depth)
        self.copy_colour, self.copy_depth = _colour(context, inner, "f2"), _depth(context, inner)
        self.copy = context.framebuffer([self.copy_colour], self.copy_depth)


def _colour(context: moderngl.Context, size: tuple[int, int], dtype: str) -> moderngl.Texture:
    texture = context.texture(size, 4, dtype=dtype)
    texture.repeat_x = texture.repeat_y = False
    return texture


def _depth(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Texture:
    texture = context.depth_texture(size)
    texture.compare_func = ""
    texture.repeat_x = texture.repeat_y = False
    return texture
