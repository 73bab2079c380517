"""Framebuffer of draped layers at several samples a pixel."""

from __future__ import annotations

from typing import Final

import moderngl

from sketchterrain.render.programs import fullscreen_pass, set_uniforms

SAMPLES: Final = 4  # a pixel


def averaging_pass(context: moderngl.Context, *, samples: int) -> moderngl.VertexArray:
    """Return the pass that `DrapedBuffer` needs, for a G-buffer of `samples` along each axis of a pixel."""
    macros = {"SAMPLES": samples, "FRAGMENTS": _fragments(context)}
    return fullscreen_pass(context, "draped_mean.frag.glsl", defines=macros)


def _fragments(context: moderngl.Context) -> int:
    return min(SAMPLES, context.max_samples)


class DrapedBuffer:
    """Albedo times share, and share, at several samples a pixel of a size (px), and their mean, `colour`."""

    def __init__(
        self, context: moderngl.Context, size: tuple[int, int], average: moderngl.VertexArray
    ) -> None:
        fragments = _fragments(context)
        self.size = size
        self.nbytes = 8 * size[0] * size[1] * (1 + fragments)
        self._context, self._average = context, average
        self._samples = context.texture(size, 4, samples=fragments, dtype="f2")
        self._drawn = context.framebuffer([self._samples])
        self.colour = context.texture(size, 4, dtype="f2")
        self.colour.repeat_x = self.colour.repeat_y = False
        self._mean = context.framebuffer([self.colour])

    def clear(self) -> None:
        """Bind and clear it, for what is premultiplied by its share."""
        self._drawn.use()
        self._drawn.clear(0.0, 0.0, 0.0, 0.0)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA

    def resolve(self, depth: moderngl.Texture, into: moderngl.Framebuffer | None = None) -> None:
        """Average the samples, and restore the usual blending.

        By default the mean is that of the samples on the ground in front by a G-buffer's depth.
        """
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._context.enable_only(moderngl.NOTHING)
        (into or self._mean).use()
        self._samples.use(7)
        depth.use(8)
        values = {"drawn": 7, "ground_depth": 8, "all_samples": float(into is not None)}
        set_uniforms(self._average.program, values)
        self._average.render(vertices=3)
