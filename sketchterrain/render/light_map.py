"""Light maps: sun and sky visibility over squares of the ground, computed in slices of rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import moderngl
import numpy as np

from sketchterrain.array_types import Bounds
from sketchterrain.geometry.box_index import merge_boxes
from sketchterrain.render.programs import clamped, fullscreen_pass, mipmapped, set_uniforms
from sketchterrain.render.quality import UNLIMITED, TimeBudget, WorkRate
from sketchterrain.render.scene import HeightMap, TerrainSource, surface_heights
from sketchterrain.render.sky import Sun

BLOCK: Final = 64
"""Squares are aligned to blocks of this many texels, so that mipmaps of overlapping squares agree."""
PENUMBRA: Final = 0.022
"""Tangent of half the angle over which the sun sets behind a ridge; the real sun's would alias,"""
SHARP_PENUMBRA: Final = 0.009
"""but on a map close to the eye less than on wider ones; the real one's is 0.0047."""

Rectangle = tuple[int, int, int, int]
"""West, south, east, north in texels from the world's origin; east and north are exclusive."""


@dataclass(frozen=True)
class TexelSquare:
    """A square of texels counted from the world's origin."""

    col: int  # of its south-west texel
    row: int
    texels: int  # along a side
    texel: float  # m

    @classmethod
    def around(cls, x: float, y: float, *, width: float, texels: int) -> TexelSquare:
        """Return the block-aligned square of a width (m) whose middle is nearest to a position (m)."""
        block = BLOCK * width / texels
        col, row = (round((middle - 0.5 * width) / block) * BLOCK for middle in (x, y))
        return cls(col, row, texels, width / texels)

    @property
    def rectangle(self) -> Rectangle:
        """All its texels."""
        return self.col, self.row, self.col + self.texels, self.row + self.texels

    def texels_in(self, areas: Sequence[Bounds]) -> list[Rectangle]:
        """Return its texels that overlap areas (m)."""
        rectangles = []
        limits = np.array(self.rectangle, np.float64)
        exclusive = np.array([0.0, 0.0, 1.0, 1.0])
        for area in areas:
            sides = np.floor(np.array(area) / self.texel) + exclusive
            sides = np.clip(sides, limits[[0, 1, 0, 1]], limits[[2, 3, 2, 3]])
            west, south, east, north = (int(side) for side in sides)
            if west < east and south < north:
                rectangles.append((west, south, east, north))
        return rectangles

    @property
    def west(self) -> float:
        """West edge (m)."""
        return self.col * self.texel

    @property
    def south(self) -> float:
        """South edge (m)."""
        return self.row * self.texel

    @property
    def width(self) -> float:
        """Side (m)."""
        return self.texels * self.texel


class LightMapRenderer:
    """Programs and measured work rates shared by all light maps; `version` counts terrains and suns."""

    def __init__(
        self, context: moderngl.Context, terrain: TerrainSource, sun: Sun, *, shadows: bool = True
    ) -> None:
        self.context = context
        self.terrain, self.sun = terrain, sun
        self.version = 0
        self._shadows = int(shadows)
        self.light_pass = self._pass(close=False)
        self.sampling = WorkRate(1e-6)  # s a texel
        self.uploading = WorkRate(2e-8)
        self.lighting = WorkRate(2e-6)
        self.lighting_close = WorkRate(4e-6)

    @cached_property
    def close_light_pass(self) -> moderngl.VertexArray:
        """Pass for maps close to the eye, whose rays continue on two wider maps."""
        return self._pass(close=True)

    def _pass(self, *, close: bool) -> moderngl.VertexArray:
        defines = {"CLOSE": int(close), "SHADOWS": self._shadows}
        light_pass = fullscreen_pass(self.context, "light.frag.glsl", defines=defines)
        units = {"heights": 0, "far_heights": 1, "widest_heights": 2, "far_light": 3}
        set_uniforms(light_pass.program, units | {"softness": SHARP_PENUMBRA if close else PENUMBRA})
        return light_pass


class LightMap:
    """Heights (R32F, m) of a square and the visibility of sun and sky over them (RGBA16F, light.frag.glsl).

    Rays that leave the square continue on `wider` maps: one, or two for a map close to the eye.
    Heights of a `previous` map with equal texels are reused. `dirty` has the rectangles of texels where the
    terrain has changed since.
    """

    def __init__(
        self,
        renderer: LightMapRenderer,
        square: TexelSquare,
        *,
        wider: Sequence[LightMap] = (),
        previous: LightMap | None = None,
    ) -> None:
        n = square.texels
        self.square = square
        self.relief = HeightMap(square.west, square.south, square.width, np.zeros((n, n), np.float32))
        self.heights = clamped(renderer.context.texture((n, n), 1, dtype="f4"))
        self.light = clamped(renderer.context.texture((n, n), 4, dtype="f2"))
        self.ready = False
        self.version, self.sun = renderer.version, renderer.sun
        self.dirty: list[Rectangle] = []
        self.wider_key = [(wider_level.square, wider_level.version) for wider_level in wider[:1]]
        self._renderer, self._terrain = renderer, renderer.terrain
        self._wider, self._close = wider, len(wider) > 1
        self._target = renderer.context.framebuffer([self.light])
        reusable = previous is not None and previous.ready
        self._pending = self._reuse(previous) if previous and reusable else [square.rectangle]
        self._lit_rows = 0
        self._uploaded = False

    def invalidate(self, areas: Sequence[Bounds]) -> None:
        """Mark areas (m) where the terrain has changed."""
        boxes = merge_boxes([*self.dirty, *self.square.texels_in(areas)])
        self.dirty = [(int(west), int(south), int(east), int(north)) for west, south, east, north in boxes]

    def advance(self, budget: TimeBudget = UNLIMITED) -> None:
        """Compute within a time budget: rows of heights, then the texture, then rows of light."""
        renderer, n = self._renderer, self.square.texels
        while self._pending:
            west, south, east, north = self._pending[0]
            if not renderer.sampling.run(budget, self._sample, step=east - west, count=north - south):
                return
        if not self._uploaded and not renderer.uploading.run(budget, self._upload, step=n * n, count=1):
            return
        rate = renderer.lighting_close if self._close else renderer.lighting
        while self._lit_rows < n:
            if not rate.run(budget, self._light_rows, step=n, count=n - self._lit_rows):
                return
        self.ready = True
        self._wider = ()

    @cached_property
    def haze_base(self) -> float:
        """5th percentile of the heights (m)."""
        return float(np.percentile(self.relief.heights, 5))

    @cached_property
    def highest(self) -> float:
        """Greatest height (m)."""
        return float(self.relief.heights.max())

    @cached_property
    def lowest(self) -> float:
        """Least height (m)."""
        return float(self.relief.heights.min())

    def _reuse(self, previous: LightMap) -> list[Rectangle]:
        """Copy the heights of a previous map; return the rectangles of texels still to be sampled."""
        first, low, last, high = self.square.rectangle
        both = _intersection(self.square.rectangle, previous.square.rectangle)
        if both is None:
            return [self.square.rectangle]
        west, south, east, north = both
        self.relief.heights[south - low : north - low, west - first : east - first] = previous.relief.heights[
            south - previous.square.row : north - previous.square.row,
            west - previous.square.col : east - previous.square.col,
        ]
        borders = [
            (first, low, last, south),
            (first, south, west, north),
            (east, south, last, north),
            (first, north, last, high),
        ]
        changed = [_intersection(both, area) for area in previous.dirty]
        pending = [(w, s, e, n) for w, s, e, n in borders if w < e and s < n]
        return pending + [area for area in changed if area is not None]

    def _sample(self, rows: int) -> None:
        """Sample the next rows of the first pending rectangle."""
        square = self.square
        west, south, east, north = self._pending.pop(0)
        end = min(south + rows, north)
        x = (np.arange(west, east) + 0.5) * square.texel
        y = (np.arange(south, end) + 0.5) * square.texel
        row, col = south - square.row, west - square.col
        self.relief.heights[row : row + end - south, col : col + east - west] = surface_heights(
            self._terrain, x[None, :], y[:, None], cell_size=square.texel
        )
        if end < north:
            self._pending.insert(0, (west, end, east, north))

    def _upload(self, _: int = 1) -> None:
        self.heights.write(self.relief.heights.tobytes())
        mipmapped(self.heights)
        self._renderer.context.finish()
        self._uploaded = True

    def _light_rows(self, rows: int) -> None:
        renderer, square = self._renderer, self.square
        wider, widest = (self._wider[0], self._wider[-1]) if self._wider else (self, self)
        light_pass = renderer.close_light_pass if self._close else renderer.light_pass
        frames = {"frame": _frame_in(square, wider.square), "widest": _frame_in(square, widest.square)}
        highest = max(each.highest for each in (self, *self._wider))
        set_uniforms(
            light_pass.program, frames | {"sun": tuple(self.sun.direction), "highest_ground": highest}
        )
        renderer.context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._target.scissor = (0, self._lit_rows, square.texels, rows)
        for unit, texture in enumerate((self.heights, wider.heights, widest.heights, wider.light)):
            texture.use(unit)
        light_pass.render(vertices=3)
        self._target.scissor = (0, 0, square.texels, square.texels)
        renderer.context.finish()
        self._lit_rows += rows


def _frame_in(square: TexelSquare, wider: TexelSquare) -> tuple[float, float, float, float]:
    """Return a square's corner and width in widths of a wider one, and its width (m)."""
    west, south = square.west - wider.west, square.south - wider.south
    return west / wider.width, south / wider.width, square.width / wider.width, square.width


def _intersection(one: Rectangle, other: Rectangle) -> Rectangle | None:
    west, south = max(one[0], other[0]), max(one[1], other[1])
    east, north = min(one[2], other[2]), min(one[3], other[3])
    return (west, south, east, north) if west < east and south < north else None
