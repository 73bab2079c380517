"""Clipmap of light on the ground around a moving eye, updated without visible steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.array_types import Bounds
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.light_map import LightMap, LightMapRenderer, TexelSquare
from sketchterrain.render.programs import clamped, fullscreen_pass, set_uniforms
from sketchterrain.render.quality import UNLIMITED, TimeBudget
from sketchterrain.render.scene import TerrainSource
from sketchterrain.render.sky import Sun

FADE: Final = 0.5  # shortest duration of each step of a transition, s
SOFT: Final = 0.04
"""Width of a window's soft border in widths of its map, see ground_light in kernels/render/frame.glsl."""
SLOWEST: Final = 4.0
"""Longest duration of a window's motion, times `FADE`: its soft border passes a place in about one fade."""
NEAR: Final = 1.3  # widths of the near, far and close map, tile extents
FAR: Final = 5.0
CLOSE: Final = 0.2
AHEAD: Final = 0.32  # offset of the near and the close map's middle ahead of the eye, in their widths
EASE: Final = 150.0  # rate at which the haze base follows the terrain, m/s


class Window(NamedTuple):
    """A rectangle with soft borders in which a map is visible (m)."""

    west: float
    south: float
    east: float
    north: float

    @classmethod
    def full(cls, square: TexelSquare) -> Window:
        """Return the window of a whole square."""
        return cls(square.west, square.south, square.west + square.width, square.south + square.width)

    def interpolated(self, other: Window, share: float) -> Window:
        """Interpolate linearly towards another window."""
        return Window(*(a + share * (b - a) for a, b in zip(self, other, strict=True)))

    def intersection(self, other: Window) -> Window:
        """Return the intersection with another window."""
        return Window(*np.maximum(self[:2], other[:2]).tolist(), *np.minimum(self[2:], other[2:]).tolist())

    @property
    def empty(self) -> bool:
        """Whether it has no area."""
        return self.west >= self.east or self.south >= self.north


class ClipmapLevel:
    """One light map on screen and its successor.

    A ready successor is faded in in three steps: the old window shrinks to the overlap of both, the light is
    blended there, and the window grows. Maps of the same square are only blended; without an overlap, or
    without a current map, the new one fades in (step 4).
    """

    def __init__(self, context: moderngl.Context) -> None:
        self.current: LightMap | None = None
        self.pending: LightMap | None = None
        self.window = Window(0.0, 0.0, 0.0, 0.0)
        self.strength = 0.0
        self.light = context.texture((1, 1), 4, np.ones(4, np.float16).tobytes(), dtype="f2")
        self._no_heights = context.texture((1, 1), 1, np.zeros(1, np.float32).tobytes(), dtype="f4")
        self._context = context
        self._blend_pass = fullscreen_pass(context, "light_fade.frag.glsl")
        self.step, self._elapsed = 0, 0.0
        self._start = self._overlap = self.window
        self._previous: LightMap | None = None
        self._target: moderngl.Framebuffer | None = None

    @property
    def heights(self) -> moderngl.Texture:
        """Heights of the current map (m)."""
        return self._no_heights if self.current is None else self.current.heights

    @property
    def converged(self) -> bool:
        """Whether the current map is up to date and no transition is running."""
        up_to_date = self.current is not None and not self.current.dirty
        return up_to_date and self.pending is None and self.step == 0 and self.strength == 1.0

    @property
    def version(self) -> int:
        """Version of the current map, -1 without one."""
        return -1 if self.current is None else self.current.version

    def set_current(self, light_map: LightMap) -> None:
        """Replace the current map at once."""
        self.current, self.pending, self.light = light_map, None, light_map.light
        self.window, self.strength, self.step = Window.full(light_map.square), 1.0, 0

    def invalidate(self, areas: Sequence[Bounds]) -> None:
        """Mark areas (m) where the terrain has changed."""
        for light_map in (self.current, self.pending):
            if light_map is not None:
                light_map.invalidate(areas)

    def advance_transition(self, elapsed: float) -> None:
        """Advance the transition to a ready map by a frame time (s)."""
        if self.step == 0 and self.pending is not None and self.pending.ready:
            self._start_transition(self.pending)
        elif self.step:
            self._elapsed += elapsed
            self._apply(min(self._elapsed / self._duration(), 1.0))

    def _duration(self) -> float:
        """Return the duration of the current step (s)."""
        if self.step not in (1, 3) or self.current is None:
            return FADE
        start = self._start if self.step == 1 else Window.full(self.current.square)
        distance = max(abs(a - b) for a, b in zip(start, self._overlap, strict=True))
        return FADE * min(max(distance / (SOFT * self.current.square.width), 1.0), SLOWEST)

    def _start_transition(self, pending: LightMap) -> None:
        self._start, self._elapsed = self.window, 0.0
        self._overlap = self.window.intersection(Window.full(pending.square))
        if self.current is None or self._overlap.empty:
            self.set_current(pending)
            self.strength, self.step = 0.0, 4
        else:
            self.step = 1
            if self._start == self._overlap:
                self._next_step()

    def _apply(self, share: float) -> None:
        if self.step == 1:
            self.window = self._start.interpolated(self._overlap, share)
        elif self.step == 2:
            self._blend(share)
        elif self.step == 3 and self.current is not None:
            self.window = self._overlap.interpolated(Window.full(self.current.square), share)
        elif self.step == 4:
            self.strength = share
        if share == 1.0:
            self._next_step()

    def _next_step(self) -> None:
        self._elapsed = 0.0
        if self.step == 1 and self.current is not None and self.pending is not None:
            self._previous, self.current, self.pending = self.current, self.pending, None
            n = self.current.square.texels
            self.light = clamped(self._context.texture((n, n), 4, dtype="f2"))
            self._target = self._context.framebuffer([self.light])
            self._blend(0.0)
        elif self.step == 2 and self.current is not None:
            self.light = self.current.light
            self._previous = self._target = None
            if self._overlap == Window.full(self.current.square):
                self.step = 3
        self.step = 0 if self.step > 2 else self.step + 1

    def _blend(self, share: float) -> None:
        new, old, target = self.current, self._previous, self._target
        if new is None or old is None or target is None:
            return
        shift = (new.square.col - old.square.col, new.square.row - old.square.row)
        set_uniforms(self._blend_pass.program, {"old": 0, "new": 1, "shift": shift, "share": share})
        old.light.use(0)
        new.light.use(1)
        self._context.enable_only(moderngl.NOTHING)
        target.use()
        self._blend_pass.render(vertices=3)


class GroundLighting:
    """A near and a far map of the light on the ground, and optionally a sharp one close to the eye.

    The far map has half of `texels` a side, the others all. `haze_base` (m) follows the far map's heights.
    """

    def __init__(
        self,
        context: moderngl.Context,
        terrain: TerrainSource,
        sun: Sun,
        *,
        texels: int,
        close: bool = False,
        shadows: bool = True,
    ) -> None:
        self._renderer = LightMapRenderer(context, terrain, sun, shadows=shadows)
        self._extent = terrain.extent
        self._texels = texels
        names = ("near", "far", "close") if close else ("near", "far")
        self._levels = {name: ClipmapLevel(context) for name in names}
        self._near, self._far = self._levels["near"], self._levels["far"]
        self.haze_base = 0.0
        self._has_haze_base = False

    @property
    def converged(self) -> bool:
        """Whether all maps are complete and displayed for the last camera."""
        eased = self.haze_base == self._target_haze_base()
        return all(level.converged for level in self._levels.values()) and eased

    @property
    def _from_far(self) -> list[tuple[str, ClipmapLevel]]:
        """The levels in order of dependency."""
        near, far, *close = self._levels.items()
        return [far, near, *close]

    @property
    def textures(self) -> dict[str, moderngl.Texture]:
        """Textures by sampler name."""
        lights = {f"{name}_light": level.light for name, level in self._levels.items()}
        return lights | {"near_heights": self._near.heights}

    @property
    def height_maps(self) -> dict[str, tuple[moderngl.Texture, float]]:
        """Heights (m), with mipmaps, and the width of their texels (m) of the near and the far map."""
        pairs = {"near": self._near, "far": self._far}
        return {
            name: (level.heights, 1.0 if level.current is None else level.current.square.texel)
            for name, level in pairs.items()
        }

    @property
    def height_range(self) -> tuple[float, float]:
        """Lowest and highest ground (m) of the far map."""
        far = self._far.current
        return (0.0, 0.0) if far is None else (far.lowest, far.highest)

    def height_at(self, x: float, y: float) -> float:
        """Return the ground's height (m) by the near map, outside it by the far one, else 0."""
        for level in (self._near, self._far):
            if level.current is not None:
                relief = level.current.relief
                inside = 0 <= x - relief.west <= relief.width and 0 <= y - relief.south <= relief.width
                if inside or level is self._far:
                    return float(relief.at(x, y))
        return 0.0

    def uniforms(self, eye: tuple[float, float, float]) -> dict[str, tuple[float, ...]]:
        """Return the frame block's fields for an eye: positions and visible windows of the maps."""
        fields: dict[str, tuple[float, ...]] = {}
        for name, level in self._levels.items():
            square = TexelSquare(0, 0, 1, 1.0) if level.current is None else level.current.square
            corner = (square.west - eye[0], square.south - eye[1])
            fields[f"{name}_map"] = (*corner, 1.0 / square.width, square.texel)
            west, south, east, north = level.window
            fields[f"{name}_window"] = (west - eye[0], south - eye[1], east - eye[0], north - eye[1])
        fields["map_strength"] = tuple(level.strength for level in self._levels.values())
        return fields

    def update(self, camera: Camera, elapsed: float, budget: TimeBudget) -> None:
        """Advance by a frame: compute within the budget and advance transitions."""
        squares = self._squares(camera)
        for level in self._levels.values():
            level.advance_transition(elapsed)
        self._ease_haze(elapsed)
        # Oldest first: every level gets its turn even if the terrain changes all the time.
        for name, level in sorted(self._from_far, key=lambda each: each[1].version):
            wider = self._wider(name)
            if wider is not None:
                self._request(level, squares[name], wider)
                if level.pending is not None and not level.pending.ready:
                    level.pending.advance(budget)
            if level.current and level.pending and level.pending.version != level.version:
                break  # one refresh for another terrain or sun at a time

    def _wider(self, name: str) -> list[LightMap] | None:
        """Return the wider maps that a level's rays continue on, None if one is missing."""
        levels = {"far": [], "near": [self._far], "close": [self._near, self._far]}[name]
        maps = [level.current for level in levels if level.current is not None]
        return maps if len(maps) == len(levels) else None

    def set_terrain(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> None:
        """Replace the terrain, which differs inside areas (m) only; maps stay until new ones are ready."""
        self._renderer.terrain = terrain
        self._renderer.version += 1
        for level in self._levels.values():
            level.invalidate(areas)

    def relight(self, sun: Sun) -> None:
        """Replace the sun; current maps stay until new ones are ready."""
        self._renderer.sun = sun
        self._renderer.version += 1

    def converge(self, camera: Camera, budget: TimeBudget = UNLIMITED) -> bool:
        """Compute what a camera needs within a budget, and display it; return whether that is complete."""
        squares = self._squares(camera)
        for name, level in self._from_far:
            light_map, wider = level.current, self._wider(name) or []
            if light_map is None or not self._is_current(light_map, squares[name], wider):
                light_map = level.pending
                if light_map is None or not self._is_current(light_map, squares[name], wider):
                    light_map = level.pending = self._light_map(level, squares[name], wider)
                light_map.advance(budget)
                if not light_map.ready:
                    return False
            level.set_current(light_map)
        self.haze_base = self._target_haze_base()
        self._has_haze_base = True
        return True

    def _squares(self, camera: Camera) -> dict[str, TexelSquare]:
        (x, y, _), (ahead_x, ahead_y) = camera.eye, camera.forward[:2]
        squares = {
            name: TexelSquare.around(
                x + AHEAD * width * ahead_x, y + AHEAD * width * ahead_y, width=width, texels=self._texels
            )
            for name, width in (("near", NEAR * self._extent), ("close", CLOSE * self._extent))
        }
        far = TexelSquare.around(x, y, width=FAR * self._extent, texels=self._texels // 2)
        return squares | {"far": far}

    def _light_map(self, level: ClipmapLevel, square: TexelSquare, wider: Sequence[LightMap]) -> LightMap:
        previous = level.current
        if previous is not None and previous.square.texel != square.texel:
            previous = None
        return LightMap(self._renderer, square, wider=wider, previous=previous)

    def _request(self, level: ClipmapLevel, square: TexelSquare, wider: Sequence[LightMap]) -> None:
        """Start another map where neither the current nor the pending one is up to date."""
        pending = level.pending  # completed first if it overlaps the square: a fast eye would never get any
        if level.step in (1, 2, 3) or (
            pending and not Window.full(pending.square).intersection(Window.full(square)).empty
        ):
            return
        current = self._is_current(level.current, square, wider)
        level.pending = None if current else self._light_map(level, square, wider)

    def _is_current(self, light_map: LightMap | None, square: TexelSquare, wider: Sequence[LightMap]) -> bool:
        """Return whether a map is of this square, this terrain and this sun."""
        if light_map is None or light_map.dirty or light_map.sun != self._renderer.sun:
            return False
        wider_key = [(level.square, level.version) for level in wider[:1]]
        return light_map.square == square and light_map.wider_key == wider_key

    def _target_haze_base(self) -> float:
        return self.haze_base if self._far.current is None else self._far.current.haze_base

    def _ease_haze(self, elapsed: float) -> None:
        target, step = self._target_haze_base(), elapsed * EASE
        if not self._has_haze_base:
            self._has_haze_base = self._far.current is not None
            self.haze_base = target
        elif abs(target - self.haze_base) <= step:
            self.haze_base = target
        else:
            self.haze_base += float(np.copysign(step, target - self.haze_base))
