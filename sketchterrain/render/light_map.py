"""The light of sun and sky on a square of the ground, made in slices of rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.render.allowance import Pace
from sketchterrain.render.programs import fill_screen, set_uniforms
from sketchterrain.render.relief import HeightMap

if TYPE_CHECKING:
    from sketchterrain.render.allowance import Allowance
    from sketchterrain.render.scene import Terrain
    from sketchterrain.render.sky import Sun

__all__ = ["BLOCK", "LightMaker", "LightMap", "Square"]

BLOCK: Final = 64
"""Squares lie on whole blocks of so many texels, so that mipmaps of two squares agree where both lie."""
PENUMBRA: Final = 0.022
"""Tangent of half the angle over which the sun sets behind a ridge; the real sun's would alias,"""
SHARP_PENUMBRA: Final = 0.009
"""but on a map close to the eye less than on wider ones; the real one's is 0.0047."""


@dataclass(frozen=True)
class Square:
    """A square of texels, counted from the world's origin.

    Attributes
    ----------
    col, row : int
        Of its south-west texel.
    texels : int
        Along a side.
    texel : float
        Width of one (m).
    """

    col: int
    row: int
    texels: int
    texel: float

    @classmethod
    def around(cls, x: float, y: float, *, width: float, texels: int) -> Square:
        """Return the square of a width (m) whose middle is nearest to a place (m), on whole blocks."""
        block = BLOCK * width / texels
        col, row = (round((middle - 0.5 * width) / block) * BLOCK for middle in (x, y))
        return cls(col, row, texels, width / texels)

    @property
    def west(self) -> float:
        """Its corner (m)."""
        return self.col * self.texel

    @property
    def south(self) -> float:
        """Its corner (m)."""
        return self.row * self.texel

    @property
    def width(self) -> float:
        """Its side (m)."""
        return self.texels * self.texel


class LightMaker:
    """What all maps of one sun share: the program, and how quick the machine is.

    Parameters
    ----------
    context
        Where they are made.
    terrain
        Whose ground.
    sun
        What shines.
    shadows
        Whether ground keeps it from ground.
    """

    def __init__(
        self, context: moderngl.Context, terrain: Terrain, sun: Sun, *, shadows: bool = True
    ) -> None:
        self.context = context
        self.terrain = terrain
        self._uniforms = {
            "heights": 0,
            "far_heights": 1,
            "widest_heights": 2,
            "far_light": 3,
            "sun": tuple(sun.direction),
        }
        self._shadows = int(shadows)
        self.shine = self._program(close=False)
        self.sampling = Pace(1e-6)  # s a texel
        self.uploading = Pace(2e-8)
        self.lighting = Pace(2e-6)
        self.lighting_close = Pace(4e-6)

    @cached_property
    def shine_close(self) -> moderngl.VertexArray:
        """For maps close to the eye: steps go on over two wider maps."""
        return self._program(close=True)

    def _program(self, *, close: bool) -> moderngl.VertexArray:
        defines = {"CLOSE": int(close), "SHADOWS": self._shadows}
        made = fill_screen(self.context, "light.frag.glsl", defines=defines)
        softness = SHARP_PENUMBRA if close else PENUMBRA
        set_uniforms(made.program, self._uniforms | {"softness": softness})
        return made


class LightMap:
    """Heights of a square and the visibility of sun and sky over them.

    Parameters
    ----------
    maker
        What makes it.
    square
        Where.
    behind
        A wider map, for ground that stands before the sun outside this one; None: none does.
    beyond
        For a map close to the eye: one that is wider still.
    known
        Heights that need not be sampled again, with texels as wide as the square's.

    Attributes
    ----------
    square : Square
        Where.
    behind : Square or None
        Where the wider map was.
    relief : HeightMap
        Heights; valid when they are sampled, all of them once the map is ready.
    heights : moderngl.Texture
        R32F, m.
    light : moderngl.Texture
        RGBA16F: sun visibility, sky visibility; kernels/render/light.frag.glsl.
    ready : bool
        Whether all of it is made.
    """

    def __init__(
        self,
        maker: LightMaker,
        square: Square,
        *,
        behind: LightMap | None = None,
        beyond: LightMap | None = None,
        known: LightMap | None = None,
    ) -> None:
        n = square.texels
        self.square = square
        self.relief = HeightMap(square.west, square.south, square.width, np.zeros((n, n), np.float32))
        self.heights = maker.context.texture((n, n), 1, dtype="f4")
        self.light = maker.context.texture((n, n), 4, dtype="f2")
        self.ready = False
        self._maker = maker
        self.behind = None if behind is None else behind.square
        self._behind, self._beyond = behind, beyond
        self._close = beyond is not None
        self._known = known if known is not None and known.ready else None
        self._target = maker.context.framebuffer([self.light])
        self._sampled = self._lit = 0
        self._uploaded = False
        for texture in (self.heights, self.light):
            texture.repeat_x = texture.repeat_y = False
        self.light.filter = (moderngl.LINEAR, moderngl.LINEAR)

    def go_on(self, allowance: Allowance) -> None:
        """Make what an allowance allows: rows of heights, then the texture, then rows of light."""
        maker, n = self._maker, self.square.texels
        while self._sampled < n:
            rows = min(maker.sampling.fits(allowance, step=n), n - self._sampled)
            if not rows:
                return
            before = allowance.spent
            rows = self._sample(rows)
            maker.sampling.took(rows * n, allowance.spent - before)
        if not self._uploaded:
            if not maker.uploading.fits(allowance, step=n * n):
                return
            before = allowance.spent
            self._upload()
            maker.uploading.took(n * n, allowance.spent - before)
        pace = maker.lighting_close if self._close else maker.lighting
        while self._lit < n:
            rows = min(pace.fits(allowance, step=n), n - self._lit)
            if not rows:
                return
            before = allowance.spent
            self._shine(rows)
            pace.took(rows * n, allowance.spent - before)
        self._end()

    def finish(self) -> None:
        """Make all that is missing at once."""
        n = self.square.texels
        while self._sampled < n:
            self._sample(n - self._sampled)
        if not self._uploaded:
            self._upload()
        if self._lit < n:
            self._shine(n - self._lit)
        self._end()

    @cached_property
    def haze_base(self) -> float:
        """Height (m) that one in twenty of the texels lies below."""
        return float(np.percentile(self.relief.heights, 5))

    def _end(self) -> None:
        self.ready = True
        self._behind = self._beyond = None

    def _sample(self, rows: int) -> int:
        """Sample the next rows, or less where that is one rectangle; return how many."""
        square, first = self.square, self._sampled
        left, right = 0, square.texels
        if self._known is not None:
            known = self._known.square
            east, north = square.col - known.col, square.row - known.row  # where this one begins in the known
            low, high = max(-north, 0), min(known.texels - north, square.texels)
            if first < low:
                rows = min(rows, low - first)
            elif first < high and abs(east) < known.texels:
                rows = min(rows, high - first)
                start, stop = max(-east, 0), min(known.texels - east, square.texels)
                from_known = self._known.relief.heights[first + north : first + north + rows]
                self.relief.heights[first : first + rows, start:stop] = from_known[
                    :, start + east : stop + east
                ]
                left, right = (0, start) if start else (stop, square.texels)
        if left < right:
            x = (square.col + np.arange(left, right) + 0.5) * square.texel
            y = (square.row + np.arange(first, first + rows) + 0.5) * square.texel
            self.relief.heights[first : first + rows, left:right] = self._maker.terrain.heights(
                x[None, :], y[:, None], cell_size=square.texel
            )
        self._sampled += rows
        self._known = self._known if self._sampled < square.texels else None
        return rows

    def _upload(self) -> None:
        self.heights.write(self.relief.heights.tobytes())
        self.heights.build_mipmaps()
        self.heights.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        self._maker.context.finish()
        self._uploaded = True

    def _shine(self, rows: int) -> None:
        maker, square, wider = self._maker, self.square, self._behind or self
        widest = self._beyond or wider
        shine = maker.shine_close if self._close else maker.shine
        places = {"frame": _place_in(square, wider.square), "widest": _place_in(square, widest.square)}
        set_uniforms(shine.program, places)
        maker.context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._target.scissor = (0, self._lit, square.texels, rows)
        self.heights.use(0)
        wider.heights.use(1)
        widest.heights.use(2)
        wider.light.use(3)
        shine.render(vertices=3)
        self._target.scissor = (0, 0, square.texels, square.texels)
        maker.context.finish()
        self._lit += rows


def _place_in(square: Square, wider: Square) -> tuple[float, float, float, float]:
    """Return a square's corner and width in widths of a wider one, and its width (m)."""
    west, south = square.west - wider.west, square.south - wider.south
    return west / wider.width, south / wider.width, square.width / wider.width, square.width
