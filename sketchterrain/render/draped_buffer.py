"""Framebuffer of draped layers at several samples a pixel."""

from __future__ import annotations

from typing import Final

import moderngl

from sketchterrain.render.programs import fullscreen_pass, set_uniforms

SAMPLES: Final = 4  # a pixel


class DrapedBuffer:
    """Albedo times share, and share, at several samples a pixel of a size (px), and their mean, `colour`.

    With `samples`, those of a G-buffer along each axis of a pixel, the mean is that of the ground in front.
    """

    def __init__(self, context: moderngl.Context, size: tuple[int, int], *, samples: int = 0) -> None:
        fragments = min(SAMPLES, context.max_samples)
        self.size = size
        self.nbytes = 8 * size[0] * size[1] * (1 + fragments)
        self._context = context
        self._samples = context.texture(size, 4, samples=fragments, dtype="f2")
        self._drawn = context.framebuffer([self._samples])
        self.colour = context.texture(size, 4, dtype="f2")
        self.colour.repeat_x = self.colour.repeat_y = False
        self._mean = context.framebuffer([self.colour])
        macros = {"SAMPLES": samples, "FRAGMENTS": fragments}
        self._average = fullscreen_pass(context, "draped_mean.frag.glsl", defines=macros)

    def clear(self) -> None:
        """Bind and clear it."""
        self._drawn.use()
        self._drawn.clear(0.0, 0.0, 0.0, 0.0)
        self.use()

    def use(self) -> None:
        """Bind it, for what is premultiplied by its share."""
        self._drawn.use()
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA

    def resolve(self, depth: moderngl.Texture | None = None) -> None:
        """Average the samples, with the depth of the G-buffer, and restore the usual blending."""
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._context.enable_only(moderngl.NOTHING)
        self._mean.use()
        self._samples.use(1)
        if depth is not None:
            depth.use(2)
        set_uniforms(self._average.program, {"drawn": 1, "ground_depth": 2})
        self._average.render(vertices=3)
