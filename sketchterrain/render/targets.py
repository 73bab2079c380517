"""The framebuffers that a picture passes through."""

from __future__ import annotations

import moderngl


class RenderTargets:
    """Framebuffers for pictures of one size.

    What is seen is found out at samples² samples a pixel and shaded at one; see spread.frag.glsl.

    Attributes
    ----------
    size, inner : (int, int)
        Of the picture, and of what is seen (px).
    depth : moderngl.Texture
        Of what is seen and of the scene.
    seen : moderngl.Framebuffer
        Depth, normal and material weights of the ground, at all samples.
    shaded, sky : moderngl.Framebuffer
        Radiance of the ground and of the sky, at one sample a pixel. Only with more than one.
    spread : moderngl.Framebuffer
        Radiance at all samples, without depth.
    scene : moderngl.Framebuffer
        The same with depth, for what is drawn upon the ground.
    copy : moderngl.Framebuffer
        Holds a copy of the scene that water can look into.
    tonemapped : moderngl.Framebuffer
        The picture, where it has to be enlarged.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int], samples: int) -> None:
        self.size = size
        inner = (size[0] * samples, size[1] * samples)
        self.inner = inner
        self.depth = depth = _depth(context, inner)
        normal = _colour(context, inner, "f2")
        low, high = _colour(context, inner, "f1"), _colour(context, inner, "f1")
        colour = _colour(context, inner, "f2")
        copy_colour, copy_depth = _colour(context, inner, "f2"), _depth(context, inner)
        tonemapped = _colour(context, size, "f1")
        tonemapped.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.gbuffer = context.framebuffer([normal, low, high], depth)
        self.spread = context.framebuffer([colour])
        self.scene = context.framebuffer([colour], depth)
        self.copy = context.framebuffer([copy_colour], copy_depth)
        self.tonemapped = context.framebuffer([tonemapped])
        self.textures = {
            "gbuffer_depth": copy_depth if samples == 1 else depth,
            "gbuffer_normal": normal,
            "gbuffer_weights_low": low,
            "gbuffer_weights_high": high,
            "drawn": colour,
            "scene": copy_colour,
            "scene_depth": copy_depth,
            "tonemapped": tonemapped,
        }
        """By the names that shaders know them by."""
        if samples > 1:
            self.textures["shaded"] = _colour(context, size, "f4")
            self.textures["sky"] = _colour(context, size, "f2")
            self.shaded = context.framebuffer([self.textures["shaded"]])
            self.sky = context.framebuffer([self.textures["sky"]])
        self._context = context

    def copy_scene(self) -> None:
        """Copy light and depth, so that passes can read what they draw upon."""
        self.scene.use()  # a copy is cut by the scissor of whichever framebuffer is in use
        self._context.copy_framebuffer(self.copy, self.scene)


def _colour(context: moderngl.Context, size: tuple[int, int], dtype: str) -> moderngl.Texture:
    texture = context.texture(size, 4, dtype=dtype)
    texture.repeat_x = texture.repeat_y = False
    return texture


def _depth(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Texture:
    texture = context.depth_texture(size)
    texture.compare_func = ""
    texture.repeat_x = texture.repeat_y = False
    return texture
