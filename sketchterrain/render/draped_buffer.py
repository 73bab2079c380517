"""Framebuffer of draped layers at several samples a pixel."""

from __future__ import annotations

from typing import Final

import moderngl

SAMPLES: Final = 4  # a pixel


class DrapedBuffer:
    """Albedo times share, and share, at several samples a pixel of a size (px), and their mean, `colour`."""

    def __init__(self, context: moderngl.Context, size: tuple[int, int], *, linear: bool = False) -> None:
        samples = min(SAMPLES, context.max_samples)
        self.size = size
        self.nbytes = 8 * size[0] * size[1] * (1 + samples)
        self._context = context
        self._drawn = context.framebuffer([context.renderbuffer(size, 4, samples=samples, dtype="f2")])
        self.colour = context.texture(size, 4, dtype="f2")
        kind = moderngl.LINEAR if linear else moderngl.NEAREST
        self.colour.filter = (kind, kind)
        self.colour.repeat_x = self.colour.repeat_y = False
        self._mean = context.framebuffer([self.colour])

    def clear(self) -> None:
        """Bind and clear it, for what is premultiplied by its share."""
        self._drawn.use()
        self._drawn.clear(0.0, 0.0, 0.0, 0.0)
        self.use()

    def use(self) -> None:
        """Bind it."""
        self._drawn.use()
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA

    def resolve(self) -> None:
        """Average the samples, and restore the usual blending."""
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._context.copy_framebuffer(self._mean, self._drawn)
