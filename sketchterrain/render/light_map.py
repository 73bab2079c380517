"""Light map: a clipmap of sun visibility and sky irradiance around the eye."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.array_types import Bounds
from sketchterrain.render.budgets import WorkRate
from sketchterrain.render.programs import fullscreen_pass, set_uniforms
from sketchterrain.render.scene import HeightMap

if TYPE_CHECKING:
    from sketchterrain.render.budgets import TimeBudget
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun


BLOCK: Final = 64
"""Squares lie on whole blocks of so many texels, so that mipmaps of two squares agree where both lie."""

Rectangle = tuple[int, int, int, int]
"""The same in texels from the world's origin, east and north beyond the last."""
_WASTE: Final = 1.25
"""Rectangles become one where that is no more than so many times their texels."""


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
    def whole(self) -> Rectangle:
        """All its texels."""
        return self.col, self.row, self.col + self.texels, self.row + self.texels

    def texels_in(self, areas: Sequence[Bounds]) -> list[Rectangle]:
        """Return those of its texels that areas (m) meet."""
        found = []
        limits = np.array(self.whole, np.float64)
        beyond = np.array([0.0, 0.0, 1.0, 1.0])
        for area in areas:
            sides = np.floor(np.array(area) / self.texel) + beyond
            sides = np.clip(sides, limits[[0, 1, 0, 1]], limits[[2, 3, 2, 3]])
            west, south, east, north = (int(side) for side in sides)
            if west < east and south < north:
                found.append((west, south, east, north))
        return found

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


def place_in(square: Square, wider: Square) -> tuple[float, float, float, float]:
    """Return a square's corner and width in widths of a wider one, and its width (m)."""
    west, south = square.west - wider.west, square.south - wider.south
    return west / wider.width, south / wider.width, square.width / wider.width, square.width


def overlap(one: Rectangle, other: Rectangle) -> Rectangle | None:
    """Return what two rectangles have in common, None if that is nothing."""
    west, south, east, north = (
        max(one[0], other[0]),
        max(one[1], other[1]),
        min(one[2], other[2]),
        min(one[3], other[3]),
    )
    return (west, south, east, north) if west < east and south < north else None


def joined(rectangles: Sequence[Rectangle]) -> list[Rectangle]:
    """Return fewer rectangles that cover the same: those that overlap far enough are one."""
    found: list[Rectangle] = []
    for each in rectangles:
        both, again = each, True
        while again:
            again = False
            for other in found:
                around = _around(both, other)
                if _count(around) <= _WASTE * (_count(both) + _count(other)):
                    found.remove(other)
                    both, again = around, True
                    break
        found.append(both)
    return found


def _around(one: Rectangle, other: Rectangle) -> Rectangle:
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _count(rectangle: Rectangle) -> int:
    west, south, east, north = rectangle
    return (east - west) * (north - south)


PENUMBRA: Final = 0.022
"""Tangent of half the angle over which the sun sets behind a ridge; the real sun's would alias,"""
SHARP_PENUMBRA: Final = 0.009
"""but on a map close to the eye less than on wider ones; the real one's is 0.0047."""


class LightMaker:
    """What all maps share: the programs, and how quick the machine is.

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

    Attributes
    ----------
    terrain, sun
        Of maps that are begun from now on.
    version : int
        Counts the terrains and suns.
    """

    def __init__(
        self, context: moderngl.Context, terrain: TerrainSource, sun: Sun, *, shadows: bool = True
    ) -> None:
        self.context = context
        self.terrain, self.sun = terrain, sun
        self.version = 0
        self._uniforms = {
            "heights": 0,
            "far_heights": 1,
            "widest_heights": 2,
            "far_light": 3,
        }
        self._shadows = int(shadows)
        self.shine = self._program(close=False)
        self.sampling = WorkRate(1e-6)  # s a texel
        self.uploading = WorkRate(2e-8)
        self.lighting = WorkRate(2e-6)
        self.lighting_close = WorkRate(4e-6)

    @cached_property
    def shine_close(self) -> moderngl.VertexArray:
        """For maps close to the eye: steps go on over two wider maps."""
        return self._program(close=True)

    def _program(self, *, close: bool) -> moderngl.VertexArray:
        defines = {"CLOSE": int(close), "SHADOWS": self._shadows}
        made = fullscreen_pass(self.context, "light.frag.glsl", defines=defines)
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
    version : int
        Of its maker when it was begun.
    sun : Sun
        What shines on it.
    behind : (Square, int) or None
        Where the wider map was, and its version.
    outdated : list of (int, int, int, int)
        Texels, from the world's origin, at which the ground is another one by now.
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
        self.version, self.sun = maker.version, maker.sun
        self.outdated: list[Rectangle] = []
        self._maker, self._terrain = maker, maker.terrain
        self.behind = None if behind is None else (behind.square, behind.version)
        self._behind, self._beyond = behind, beyond
        self._close = beyond is not None
        self._target = maker.context.framebuffer([self.light])
        self._left = [square.whole] if known is None or not known.ready else self._copied(known)
        self._lit = 0
        self._uploaded = False
        for texture in (self.heights, self.light):
            texture.repeat_x = texture.repeat_y = False
        self.light.filter = (moderngl.LINEAR, moderngl.LINEAR)

    def change(self, areas: Sequence[Bounds]) -> None:
        """Note that the ground is another one in some areas (m)."""
        self.outdated = joined(self.outdated + self.square.texels_in(areas))

    def go_on(self, allowance: TimeBudget) -> None:
        """Make what an allowance allows: rows of heights, then the texture, then rows of light."""
        maker, n = self._maker, self.square.texels
        while self._left:
            west, south, east, north = self._left[0]
            rows = min(maker.sampling.steps_within(allowance, step=east - west), north - south)
            if not rows:
                return
            before = allowance.spent
            self._sample(rows)
            maker.sampling.record(rows * (east - west), allowance.spent - before)
        if not self._uploaded:
            if not maker.uploading.steps_within(allowance, step=n * n):
                return
            before = allowance.spent
            self._upload()
            maker.uploading.record(n * n, allowance.spent - before)
        pace = maker.lighting_close if self._close else maker.lighting
        while self._lit < n:
            rows = min(pace.steps_within(allowance, step=n), n - self._lit)
            if not rows:
                return
            before = allowance.spent
            self._shine(rows)
            pace.record(rows * n, allowance.spent - before)
        self._end()

    def finish(self) -> None:
        """Make all that is missing at once."""
        n = self.square.texels
        while self._left:
            self._sample(n)
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

    def _copied(self, known: LightMap) -> list[Rectangle]:
        """Take the heights that are known; return the texels that are left to be sampled."""
        square = self.square
        both = overlap(square.whole, known.square.whole)
        if both is None:
            return [square.whole]
        west, south, east, north = both
        first, last, low, high = square.whole[0], square.whole[2], square.whole[1], square.whole[3]
        self.relief.heights[south - low : north - low, west - first : east - first] = known.relief.heights[
            south - known.square.row : north - known.square.row,
            west - known.square.col : east - known.square.col,
        ]
        beside = [
            (first, low, last, south),
            (first, south, west, north),
            (east, south, last, north),
            (first, north, last, high),
        ]
        changed = [overlap(both, each) for each in known.outdated]
        left = [(w, s, e, n) for w, s, e, n in beside if w < e and s < n]
        return left + [each for each in changed if each is not None]

    def _sample(self, rows: int) -> None:
        """Sample the next rows of what is left, of one rectangle at most."""
        square = self.square
        west, south, east, north = self._left.pop(0)
        end = min(south + rows, north)
        x = (np.arange(west, east) + 0.5) * square.texel
        y = (np.arange(south, end) + 0.5) * square.texel
        row, col = south - square.row, west - square.col
        self.relief.heights[row : row + end - south, col : col + east - west] = self._terrain.heights(
            x[None, :], y[:, None], cell_size=square.texel
        )
        if end < north:
            self._left.insert(0, (west, end, east, north))

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
        places = {"frame": place_in(square, wider.square), "widest": place_in(square, widest.square)}
        set_uniforms(shine.program, places | {"sun": tuple(self.sun.direction)})
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
