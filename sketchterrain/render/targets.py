"""Framebuffers of the render passes: G-buffer, shading, scene, tone mapping."""

from __future__ import annotations

import moderngl


class RenderTargets:
    """Framebuffers for pictures of `size` (px): visibility at samples² samples a pixel, shading at one.

    `gbuffer` has depth, normal and material weights of the terrain at all samples (`sample_size`, px). With
    more than one sample `shaded` and `sky` have radiance at one sample a pixel, and `upsampled` receives it
    at all samples (spread.frag.glsl). `scene` is the same colour buffer with depth, for plants and water,
    `copy` a copy of it that water reads, `tonemapped` the picture if it is to be enlarged. `textures` has all
    of them by sampler name.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int], samples: int) -> None:
        self.size = size
        sample_size = (size[0] * samples, size[1] * samples)
        self.sample_size = sample_size
        self.depth = depth = _depth(context, sample_size)
        normal = _colour(context, sample_size, "f2")
        low, high = _colour(context, sample_size, "f1"), _colour(context, sample_size, "f1")
        colour = _colour(context, sample_size, "f2")
        copy_colour, copy_depth = _colour(context, sample_size, "f2"), _depth(context, sample_size)
        tonemapped = _colour(context, size, "f1")
        tonemapped.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.gbuffer = context.framebuffer([normal, low, high], depth)
        self.upsampled = context.framebuffer([colour])
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
        if samples > 1:
            self.textures["shaded"] = _colour(context, size, "f4")
            self.textures["sky"] = _colour(context, size, "f2")
            self.shaded = context.framebuffer([self.textures["shaded"]])
            self.sky = context.framebuffer([self.textures["sky"]])
        self._context = context

    def copy_scene(self) -> None:
        """Copy radiance and depth of the scene, for passes that read what they draw over."""
        self.scene.use()  # the copy is clipped by the scissor of the bound framebuffer
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
