"""The light on the ground around an eye that moves: two maps that follow it without a visible step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.render.light_map import LightMaker, LightMap, Square
from sketchterrain.render.programs import fill_screen, set_uniforms

if TYPE_CHECKING:
    from sketchterrain.render.allowance import Allowance
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import Terrain
    from sketchterrain.render.sky import Sun

__all__ = ["LitGround"]

NEAR: Final = 1.3
"""Width of the near map, extents."""
FAR: Final = 5.0
AHEAD: Final = 0.42
"""Extents by which the near map's middle lies before the eye."""
FADE: Final = 0.5
"""s that each step from one map to the next takes, at least."""
SOFT: Final = 0.04
"""Width of a window's soft border in widths of its map, see ground_light in kernels/render/frame.glsl."""
SLOWEST: Final = 4.0
"""Times `FADE` that a window may take to move: its soft border passes a place in a fade, or nearly."""
EASE: Final = 2.0
"""s in which the haze follows to other heights."""


class _Window(NamedTuple):
    """A rectangle in which a map is shown, its borders are soft (m)."""

    west: float
    south: float
    east: float
    north: float

    def towards(self, other: _Window, share: float) -> _Window:
        return _Window(*(a + share * (b - a) for a, b in zip(self, other, strict=True)))

    def meet(self, other: _Window) -> _Window:
        return _Window(*np.maximum(self[:2], other[:2]).tolist(), *np.minimum(self[2:], other[2:]).tolist())

    @property
    def empty(self) -> bool:
        return self.west >= self.east or self.south >= self.north


def _whole(square: Square) -> _Window:
    east, north = square.west + square.width, square.south + square.width
    return _Window(square.west, square.south, east, north)


class _Layer:
    """One of the two maps: what is shown of it, and its successor.

    A successor that is ready is shown in three steps: the window of the old one shrinks to what both cover,
    one light fades into the other there, and the window grows. Where they share nothing, or
    there was none, the new one fades in.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self.shown: LightMap | None = None
        self.coming: LightMap | None = None
        self.window = _Window(0.0, 0.0, 0.0, 0.0)
        self.strength = 0.0
        self.light = context.texture((1, 1), 4, np.ones(4, np.float16).tobytes(), dtype="f2")
        self._dark = context.texture((1, 1), 1, np.zeros(1, np.float32).tobytes(), dtype="f4")
        self._context = context
        self._mix = fill_screen(context, "light_fade.frag.glsl")
        self.step, self._gone = 0, 0.0
        self._from = self._meet = self.window
        self._old: LightMap | None = None
        self._target: moderngl.Framebuffer | None = None

    @property
    def heights(self) -> moderngl.Texture:
        return self._dark if self.shown is None else self.shown.heights

    @property
    def settled(self) -> bool:
        return self.coming is None and self.step == 0 and self.strength == 1.0

    def show(self, made: LightMap) -> None:
        """Show a map at once."""
        self.shown, self.coming, self.light = made, None, made.light
        self.window, self.strength, self.step = _whole(made.square), 1.0, 0

    def make(self, allowance: Allowance) -> None:
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
        start = self._from if self.step == 1 else _whole(self.shown.square)
        way = max(abs(a - b) for a, b in zip(start, self._meet, strict=True))
        return FADE * min(max(way / (SOFT * self.shown.square.width), 1.0), SLOWEST)

    def _begin(self, coming: LightMap) -> None:
        self._from, self._meet, self._gone = self.window, self.window.meet(_whole(coming.square)), 0.0
        if self.shown is None or self._meet.empty:
            self.show(coming)
            self.strength, self.step = 0.0, 4
        else:
            self.step = 1

    def _change(self, share: float) -> None:
        if self.step == 1:
            self.window = self._from.towards(self._meet, share)
        elif self.step == 2:
            self._blend(share)
        elif self.step == 3 and self.shown is not None:
            self.window = self._meet.towards(_whole(self.shown.square), share)
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


class LitGround:
    """A near and a far map of the light on the ground.

    Parameters
    ----------
    context
        Where they are made.
    terrain
        Whose ground.
    sun
        What shines.
    texels
        Along a side of the near map; the far one has half as many.

    Attributes
    ----------
    haze_base, haze_height : float
        Height at which the haze lies, and over which it thins out (m); they follow the far map's heights.
    """

    def __init__(self, context: moderngl.Context, terrain: Terrain, sun: Sun, *, texels: int) -> None:
        self._maker = LightMaker(context, terrain, sun)
        self._extent = terrain.extent
        self._texels = texels
        self._near, self._far = _Layer(context), _Layer(context)
        self.haze_base, self.haze_height = 0.0, 300.0
        self._haze_known = False

    @property
    def settled(self) -> bool:
        """Whether all is made and shown for the last camera."""
        eased = (self.haze_base, self.haze_height) == self._haze_goal()
        return self._near.settled and self._far.settled and eased

    @property
    def textures(self) -> dict[str, moderngl.Texture]:
        """By the names that shaders know them by."""
        return {
            "near_light": self._near.light,
            "far_light": self._far.light,
            "near_heights": self._near.heights,
        }

    def height_at(self, x: float, y: float) -> float:
        """Return the ground's height (m) at a place on the near map, or beside it on the far one; else 0."""
        for layer in (self._near, self._far):
            if layer.shown is not None:
                relief = layer.shown.relief
                inside = 0 <= x - relief.west <= relief.width and 0 <= y - relief.south <= relief.width
                if inside or layer is self._far:
                    return float(relief.at(x, y))
        return 0.0

    def uniforms(self, eye: tuple[float, float, float]) -> dict[str, tuple[float, ...]]:
        """Return the frame block's fields for an eye: where the maps lie and where they are shown."""
        fields: dict[str, tuple[float, ...]] = {}
        for name, layer in (("near", self._near), ("far", self._far)):
            square = Square(0, 0, 1, 1.0) if layer.shown is None else layer.shown.square
            corner = (square.west - eye[0], square.south - eye[1])
            fields[f"{name}_map"] = (*corner, 1.0 / square.width, square.texel)
            west, south, east, north = layer.window
            fields[f"{name}_window"] = (west - eye[0], south - eye[1], east - eye[0], north - eye[1])
        fields["map_strength"] = (self._near.strength, self._far.strength)
        return fields

    def update(self, camera: Camera, elapsed: float, allowance: Allowance) -> None:
        """Go on by a frame: make a part of what is missing, and show a part of what is made."""
        near, far = self._squares(camera)
        self._far.go_on(elapsed)
        self._near.go_on(elapsed)
        self._ease(elapsed)
        self._order(self._far, far, None)
        self._far.make(allowance)
        if self._far.shown is not None:
            self._order(self._near, near, self._far.shown)
            self._near.make(allowance)

    def settle(self, camera: Camera) -> None:
        """Make and show all that a camera's picture needs at once."""
        near, far = self._squares(camera)
        for layer, square, behind in ((self._far, far, None), (self._near, near, self._far)):
            wide = None if behind is None else behind.shown
            if not _is(layer.shown, square, wide):
                made = LightMap(self._maker, square, behind=wide, known=_alike(layer.shown, square))
                made.finish()
                layer.show(made)
            elif layer.shown is not None:
                layer.show(layer.shown)
        self.haze_base, self.haze_height = self._haze_goal()
        self._haze_known = True

    def _squares(self, camera: Camera) -> tuple[Square, Square]:
        extent, (x, y, _) = self._extent, camera.eye
        ahead = camera.forward[:2] * AHEAD * extent
        near = Square.around(x + ahead[0], y + ahead[1], width=NEAR * extent, texels=self._texels)
        return near, Square.around(x, y, width=FAR * extent, texels=self._texels // 2)

    def _order(self, layer: _Layer, square: Square, behind: LightMap | None) -> None:
        """Begin another map where neither the shown one nor a coming one is what is wanted.

        One that has been begun is made first, or a quick eye would never get any, unless it is of no use.
        """
        useless = layer.coming is not None and _whole(layer.coming.square).meet(_whole(square)).empty
        if layer.step in (1, 2, 3) or (layer.coming is not None and not useless):
            return
        wanted = not _is(layer.shown, square, behind)
        known = _alike(layer.shown, square)
        layer.coming = LightMap(self._maker, square, behind=behind, known=known) if wanted else None

    def _haze_goal(self) -> tuple[float, float]:
        if self._far.shown is None:
            return self.haze_base, self.haze_height
        lowest, highest = self._far.shown.haze
        return lowest, max(1.5 * (highest - lowest), 300.0)

    def _ease(self, elapsed: float) -> None:
        base, height = self._haze_goal()
        if not self._haze_known:
            self._haze_known = self._far.shown is not None
            self.haze_base, self.haze_height = base, height
            return
        step = elapsed / EASE * 300.0
        self.haze_base = _approach(self.haze_base, base, step)
        self.haze_height = _approach(self.haze_height, height, step)


def _approach(value: float, goal: float, step: float) -> float:
    return goal if abs(goal - value) <= step else value + float(np.copysign(step, goal - value))


def _is(made: LightMap | None, square: Square, behind: LightMap | None) -> bool:
    wider = None if behind is None else behind.square
    return made is not None and made.square == square and made.behind == wider


def _alike(known: LightMap | None, square: Square) -> LightMap | None:
    return known if known is not None and known.square.texel == square.texel else None
