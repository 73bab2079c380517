"""Map of the drawn terrain around the eye, on which plants and rocks are placed.

Tiles are coarse within their tolerance and morph, so the drawn terrain deviates from the true one. Two
squares, rendered from above, hold heights, normals and material weights of the drawn triangles. Each stores
the eye that it was drawn for, so it stays valid for later eyes and is redrawn only when its content changed;
in a moving picture the two take turns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.programs import set_uniforms

if TYPE_CHECKING:
    from sketchterrain.render.ground import TileRenderer

    Eye = tuple[float, float, float]

NEAR_WIDTH: Final = 200.0
"""m."""
STEP: Final = 16
"""Texels of the grid that squares snap to."""
INTERVAL: Final = 6
"""Frames of a moving picture between two updates of a square."""


class SurfaceMap:
    """Heights, normals and material weights of the drawn terrain on two squares around the eye.

    Each square has texels² texels; the far one reaches `reach` m. `textures` has them by sampler name.
    """

    def __init__(
        self, context: moderngl.Context, tile_renderer: TileRenderer, *, texels: int, reach: float
    ) -> None:
        self._context = context
        self._tile_renderer = tile_renderer
        size = (2 * texels, texels)
        drawn = context.texture(size, 4, dtype="f4")
        low, high = (context.texture(size, 4, dtype="f1") for _ in range(2))
        self.textures = {"surface": drawn, "surface_low": low, "surface_high": high}
        for texture in self.textures.values():
            texture.repeat_x = texture.repeat_y = False
            texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._target = context.framebuffer([drawn, low, high])
        self._target.clear()
        self._array = tile_renderer.vertex_array(
            tile_renderer.create_program("surface_map.vert.glsl", "surface_map.frag.glsl")
        )
        self._near = _MapSquare(0, texels, NEAR_WIDTH)
        self._far = _MapSquare(texels, texels, max(2.0 * reach, 2.0 * NEAR_WIDTH))
        self._turn = 0
        self._invalid = False

    def update(self, eye: Eye, *, moving: bool) -> None:
        """Redraw squares whose content changed.

        The tile renderer and the frame's uniform block have the same `eye`; `moving` lets squares take turns.
        """
        self._turn = (self._turn + 1) % INTERVAL
        deferred = moving and not self._invalid
        for square, turn in ((self._far, 0), (self._near, INTERVAL // 2)):
            if not deferred or self._turn == turn or square.needs_recentring(eye):
                self._draw(square, eye)
        self._invalid = False

    def invalidate(self) -> None:
        """Update both squares in the next picture: the terrain changed."""
        self._invalid = True

    def uniforms(self, eye: Eye) -> dict[str, object]:
        """Return both squares relative to an eye (m), for surface_map.glsl."""
        return {"surface_near": self._near.uniform(eye), "surface_far": self._far.uniform(eye)}

    def _draw(self, square: _MapSquare, eye: Eye) -> None:
        west, south = square.corner_for(eye)
        x, y = west - eye[0], south - eye[1]
        tiles = self._tile_renderer.tiles_within(x, y, x + square.width, y + square.width)
        state = (west, south, self._tile_renderer.content_key(tiles))
        if state == square.state:
            return
        square.state, square.origin = state, (west, south, eye[2])
        part = (square.offset, 0, square.texels, square.texels)
        target = self._target
        target.viewport = target.scissor = part
        target.use()
        target.clear()
        self._context.enable_only(moderngl.NOTHING)
        set_uniforms(self._array.program, {"map_place": (x, y, 2.0 / square.width)})
        self._tile_renderer.draw(self._array, tiles=tiles)


class _MapSquare:
    """One of the two squares: its position in the world and in the textures, and its content."""

    def __init__(self, offset: int, texels: int, width: float) -> None:
        self.offset, self.texels, self.width = offset, texels, width
        self.state: object = None
        self.origin: Eye | None = None
        self._step = STEP * width / texels

    def corner_for(self, eye: Eye) -> tuple[float, float]:
        """Return the south-west corner (m) of the square around an eye, snapped to whole texels."""
        x, y = (np.floor((axis - 0.5 * self.width) / self._step) * self._step for axis in eye[:2])
        return float(x), float(y)

    def needs_recentring(self, eye: Eye) -> bool:
        """Return whether the eye is an eighth of the width off the centre, or nothing was drawn yet."""
        if self.origin is None:
            return True
        away = np.abs(np.array(self.origin[:2]) + 0.5 * self.width - eye[:2])
        return bool(away.max() > 0.125 * self.width)

    def uniform(self, eye: Eye) -> tuple[float, float, float, float]:
        """Return corner x and y relative to an eye (m), 1 / width, height origin relative to the eye."""
        west, south, up = self.origin or (*self.corner_for(eye), eye[2])
        return west - eye[0], south - eye[1], 1.0 / self.width, up - eye[2]
