"""A map of the ground as it is drawn around the eye: what stands on the ground reads it.

Tiles are coarse where nobody would see it and pass into each other, so the drawn ground stands off the true
one. Two squares, seen from straight above, hold heights, normals and material weights of just these
triangles. Each keeps where the eye was when it was drawn, so it is right for a later eye too and is drawn
again only when what it shows has changed; in a moving picture the two take turns.
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
"""m, side of the near square."""
STEP: Final = 16
"""Texels by which a square follows the eye."""
TURN: Final = 6
"""Frames of a moving picture after which a square is looked at again."""


class SurfaceMap:
    """Heights, normals and material weights of the drawn ground on two squares about the eye.

    Parameters
    ----------
    context
        Where it is drawn.
    pool
        What draws the ground; it has been placed for the eye that :meth:`update` is given.
    texels
        Along the side of each square.
    reach
        m; the far square ends so far from the eye, the near one `NEAR_WIDTH` / 2.

    Attributes
    ----------
    textures : dict of str to moderngl.Texture
        By the names of kernels/render/surface_map.glsl.
    """

    def __init__(self, context: moderngl.Context, pool: TileRenderer, *, texels: int, reach: float) -> None:
        self._context = context
        self._pool = pool
        size = (2 * texels, texels)
        drawn = context.texture(size, 4, dtype="f4")
        low, high = (context.texture(size, 4, dtype="f1") for _ in range(2))
        self.textures = {"surface": drawn, "surface_low": low, "surface_high": high}
        for texture in self.textures.values():
            texture.repeat_x = texture.repeat_y = False
            texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._target = context.framebuffer([drawn, low, high])
        self._target.clear()
        self._array = pool.array(pool.build("surface_map.vert.glsl", "surface_map.frag.glsl"))
        self._near = _Square(0, texels, NEAR_WIDTH)
        self._far = _Square(texels, texels, max(2.0 * reach, 2.0 * NEAR_WIDTH))
        self._turn = 0
        self._changed = False

    def update(self, eye: Eye, *, moving: bool) -> None:
        """Draw what has changed since a square was drawn.

        Parameters
        ----------
        eye
            From which the pool's tiles were placed (m); the frame's uniform block must hold the same.
        moving
            Whether squares may wait for their turn.
        """
        self._turn = (self._turn + 1) % TURN
        waits = moving and not self._changed
        for square, turn in ((self._far, 0), (self._near, TURN // 2)):
            if not waits or self._turn == turn or square.is_left_by(eye):
                self._draw(square, eye)
        self._changed = False

    def change(self) -> None:
        """Note that the ground is another one: no square waits for its turn in the next picture."""
        self._changed = True

    def uniforms(self, eye: Eye) -> dict[str, object]:
        """Return where both squares lie, seen from an eye (m)."""
        return {"surface_near": self._near.seen_from(eye), "surface_far": self._far.seen_from(eye)}

    def _draw(self, square: _Square, eye: Eye) -> None:
        west, south = square.corner_about(eye)
        x, y = west - eye[0], south - eye[1]
        tiles = self._pool.tiles_within(x, y, x + square.width, y + square.width)
        state = (west, south, self._pool.state_of(tiles))
        if state == square.state:
            return
        square.state, square.drawn_from = state, (west, south, eye[2])
        part = (square.left, 0, square.texels, square.texels)
        target = self._target
        target.viewport = target.scissor = part
        target.use()
        target.clear()
        self._context.enable_only(moderngl.NOTHING)
        set_uniforms(self._array.program, {"map_place": (x, y, 2.0 / square.width)})
        self._pool.draw(self._array, tiles=tiles)


class _Square:
    """Where one of the two lies in the world and in the textures, and what it shows."""

    def __init__(self, left: int, texels: int, width: float) -> None:
        self.left, self.texels, self.width = left, texels, width
        self.state: object = None
        self.drawn_from: Eye | None = None
        self._step = STEP * width / texels

    def corner_about(self, eye: Eye) -> tuple[float, float]:
        """Return the south-west corner (m) of the square about an eye, on whole texels of the world."""
        x, y = (np.floor((axis - 0.5 * self.width) / self._step) * self._step for axis in eye[:2])
        return float(x), float(y)

    def is_left_by(self, eye: Eye) -> bool:
        """Tell whether the eye is an eighth of its width away from the middle, or none was drawn."""
        if self.drawn_from is None:
            return True
        away = np.abs(np.array(self.drawn_from[:2]) + 0.5 * self.width - eye[:2])
        return bool(away.max() > 0.125 * self.width)

    def seen_from(self, eye: Eye) -> tuple[float, float, float, float]:
        """Return its corner and what its heights count from, relative to an eye (m); between, 1 / width."""
        west, south, up = self.drawn_from or (*self.corner_about(eye), eye[2])
        return west - eye[0], south - eye[1], 1.0 / self.width, up - eye[2]
