"""A picture of any size that is drawn into and read."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import moderngl


class PictureTarget:
    """A texture with a framebuffer that draws into it, made anew for another size."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._texture: moderngl.Texture | None = None
        self._framebuffer: moderngl.Framebuffer | None = None

    def sized(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        """Return the framebuffer, of a width and a height (px)."""
        if self._framebuffer is None or self._framebuffer.size != size:
            for old in (self._framebuffer, self._texture):
                if old is not None:
                    old.release()
            self._texture = self._context.texture(size, 4)
            self._framebuffer = self._context.framebuffer([self._texture])
        return self._framebuffer

    def read_into(self, memory: memoryview) -> None:
        """Copy what was drawn: 4 bytes a pixel, red, green, blue and one of no meaning; row 0 on top."""
        if self._texture is None:
            raise ValueError("nothing was drawn: expected `sized` to be asked before")
        width, height = self._texture.size
        read = np.frombuffer(self._texture.read(), np.uint8).reshape(height, width, 4)
        np.frombuffer(memory, np.uint8).reshape(height, width, 4)[:] = read[::-1]
