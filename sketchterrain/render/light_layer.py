"""A map of light that follows the eye without a visible step: what is shown of it, and its successor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.render.programs import fullscreen_pass, set_uniforms

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.array_types import Bounds
    from sketchterrain.render.allowance import TimeBudget
    from sketchterrain.render.light_map import LightMap
    from sketchterrain.render.light_square import Square

FADE: Final = 0.5
"""s that each step from one map to the next takes, at least."""
SOFT: Final = 0.04
"""Width of a window's soft border in widths of its map, see ground_light in kernels/render/frame.glsl."""
SLOWEST: Final = 4.0
"""Times `FADE` that a window may take to move: its soft border passes a place in a fade, or nearly."""


class Window(NamedTuple):
    """A rectangle in which a map is shown, its borders are soft (m)."""

    west: float
    south: float
    east: float
    north: float

    def towards(self, other: Window, share: float) -> Window:
        """Return what lies a share of the way to another."""
        return Window(*(a + share * (b - a) for a, b in zip(self, other, strict=True)))

    def meet(self, other: Window) -> Window:
        """Return what both cover."""
        return Window(*np.maximum(self[:2], other[:2]).tolist(), *np.minimum(self[2:], other[2:]).tolist())

    @property
    def empty(self) -> bool:
        """Whether nothing is in it."""
        return self.west >= self.east or self.south >= self.north


def whole(square: Square) -> Window:
    """Return the window of all of a square."""
    east, north = square.west + square.width, square.south + square.width
    return Window(square.west, square.south, east, north)


class Layer:
    """One of the maps: what is shown of it, and its successor.

    A successor that is ready is shown in three steps: the window of the old one shrinks to what both cover,
    one light fades into the other there, and the window grows. In the same place it need not shrink and grow.
    Where they share nothing, or there was none, the new one fades in.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self.shown: LightMap | None = None
        self.coming: LightMap | None = None
        self.window = Window(0.0, 0.0, 0.0, 0.0)
        self.strength = 0.0
        self.light = context.texture((1, 1), 4, np.ones(4, np.float16).tobytes(), dtype="f2")
        self._dark = context.texture((1, 1), 1, np.zeros(1, np.float32).tobytes(), dtype="f4")
        self._context = context
        self._mix = fullscreen_pass(context, "light_fade.frag.glsl")
        self.step, self._gone = 0, 0.0
        self._from = self._meet = self.window
        self._old: LightMap | None = None
        self._target: moderngl.Framebuffer | None = None

    @property
    def heights(self) -> moderngl.Texture:
        """Of the map that is shown (m)."""
        return self._dark if self.shown is None else self.shown.heights

    @property
    def settled(self) -> bool:
        """Whether one map is shown and none is coming."""
        current = self.shown is not None and not self.shown.outdated
        return current and self.coming is None and self.step == 0 and self.strength == 1.0

    @property
    def version(self) -> int:
        """Of the map that is shown, -1 if there is none."""
        return -1 if self.shown is None else self.shown.version

    @property
    def catches_up(self) -> bool:
        """Whether a map is being made because the ground or the sun is another one."""
        coming = self.coming
        return self.shown is not None and coming is not None and coming.version != self.version

    def show(self, made: LightMap) -> None:
        """Show a map at once."""
        self.shown, self.coming, self.light = made, None, made.light
        self.window, self.strength, self.step = whole(made.square), 1.0, 0

    def change(self, areas: Sequence[Bounds]) -> None:
        """Note that the ground is another one in some areas (m)."""
        for made in (self.shown, self.coming):
            if made is not None:
                made.change(areas)

    def make(self, allowance: TimeBudget) -> None:
        """Make a part of the coming map."""
        if self.coming is not None and not self.coming.ready:
            self.coming.go_on(allowance)

    def go_on(self, elapsed: float) -> None:
        """Go on by a frame with the change to a map that is ready."""
        if self.step == 0 and self.coming is not None and self.coming.ready:
            self._begin(self.coming)
        elif self.step:
            self._gone += elapsed
            self._change(min(self._gone / self._duration(), 1.0))

    def _duration(self) -> float:
        """How long the present step takes (s)."""
        if self.step not in (1, 3) or self.shown is None:
            return FADE
        start = self._from if self.step == 1 else whole(self.shown.square)
        way = max(abs(a - b) for a, b in zip(start, self._meet, strict=True))
        return FADE * min(max(way / (SOFT * self.shown.square.width), 1.0), SLOWEST)

    def _begin(self, coming: LightMap) -> None:
        self._from, self._meet, self._gone = self.window, self.window.meet(whole(coming.square)), 0.0
        if self.shown is None or self._meet.empty:
            self.show(coming)
            self.strength, self.step = 0.0, 4
        else:
            self.step = 1
            if self._from == self._meet:
                self._end()

    def _change(self, share: float) -> None:
        if self.step == 1:
            self.window = self._from.towards(self._meet, share)
        elif self.step == 2:
            self._blend(share)
        elif self.step == 3 and self.shown is not None:
            self.window = self._meet.towards(whole(self.shown.square), share)
        elif self.step == 4:
            self.strength = share
        if share == 1.0:
            self._end()

    def _end(self) -> None:
        self._gone = 0.0
        if self.step == 1 and self.shown is not None and self.coming is not None:
            self._old, self.shown, self.coming = self.shown, self.coming, None
            n = self.shown.square.texels
            self.light = self._context.texture((n, n), 4, dtype="f2")
            self.light.repeat_x = self.light.repeat_y = False
            self._target = self._context.framebuffer([self.light])
            self._blend(0.0)
        elif self.step == 2 and self.shown is not None:
            self.light = self.shown.light
            self._old = self._target = None
            if self._meet == whole(self.shown.square):
                self.step = 3
        self.step = 0 if self.step > 2 else self.step + 1

    def _blend(self, share: float) -> None:
        new, old, target = self.shown, self._old, self._target
        if new is None or old is None or target is None:
            return
        shift = (new.square.col - old.square.col, new.square.row - old.square.row)
        set_uniforms(self._mix.program, {"old": 0, "new": 1, "shift": shift, "share": share})
        old.light.use(0)
        new.light.use(1)
        self._context.enable_only(moderngl.NOTHING)
        target.use()
        self._mix.render(vertices=3)
