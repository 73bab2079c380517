"""Layers of the light clipmap that follow the eye."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.array_types import Bounds
from sketchterrain.render.light_map import LightMaker, LightMap, Square
from sketchterrain.render.programs import fullscreen_pass, set_uniforms

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.render.budgets import TimeBudget
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun


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


NEAR: Final = 1.3
"""Width of the near map, extents."""
FAR: Final = 5.0
CLOSE: Final = 0.2
AHEAD: Final = 0.32
"""Of their widths, by which the middles of the near and the close map lie before the eye."""
EASE: Final = 150.0
"""m/s by which the haze follows to other heights."""


class LitGround:
    """A near and a far map of the light on the ground, and, where it is to be sharp, one close to the eye.

    Parameters
    ----------
    context
        Where they are made.
    terrain
        Whose ground.
    sun
        What shines.
    texels
        Along a side of the near and the close map; the far one has half as many.
    close
        Whether there is a close one.
    shadows
        Whether ground keeps the sun from ground.

    Attributes
    ----------
    haze_base : float
        Height at which the haze lies (m); it follows the far map's heights.
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
        self._maker = LightMaker(context, terrain, sun, shadows=shadows)
        self._extent = terrain.extent
        self._texels = texels
        self._near, self._far = Layer(context), Layer(context)
        self._close = Layer(context) if close else None
        self.haze_base = 0.0
        self._haze_known = False

    @property
    def settled(self) -> bool:
        """Whether all is made and shown for the last camera."""
        eased = self.haze_base == self._haze_goal()
        return all(layer.settled for _, layer in self._layers) and eased

    @property
    def _layers(self) -> tuple[tuple[str, Layer], ...]:
        wide = (("near", self._near), ("far", self._far))
        return wide if self._close is None else (*wide, ("close", self._close))

    @property
    def _from_far(self) -> tuple[tuple[str, Layer], ...]:
        """The same in the order in which they need each other."""
        near, far, *close = self._layers
        return (far, near, *close)

    @property
    def textures(self) -> dict[str, moderngl.Texture]:
        """By the names that shaders know them by."""
        lights = {f"{name}_light": layer.light for name, layer in self._layers}
        return lights | {"near_heights": self._near.heights}

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
        for name, layer in self._layers:
            square = Square(0, 0, 1, 1.0) if layer.shown is None else layer.shown.square
            corner = (square.west - eye[0], square.south - eye[1])
            fields[f"{name}_map"] = (*corner, 1.0 / square.width, square.texel)
            west, south, east, north = layer.window
            fields[f"{name}_window"] = (west - eye[0], south - eye[1], east - eye[0], north - eye[1])
        fields["map_strength"] = tuple(layer.strength for _, layer in self._layers)
        return fields

    def update(self, camera: Camera, elapsed: float, allowance: TimeBudget) -> None:
        """Go on by a frame: make a part of what is missing, and show a part of what is made."""
        near, far, close = self._squares(camera)
        for _, layer in self._layers:
            layer.go_on(elapsed)
        self._ease(elapsed)
        squares = {"far": far, "near": near, "close": close}
        # What was made longest ago comes first: all get their turn though the ground changes all the time.
        for name, layer in sorted(self._from_far, key=lambda each: each[1].version):
            wider = self._wider(name)
            if None not in wider:
                self._order(layer, squares[name], *wider)
                layer.make(allowance)
            if layer.catches_up:
                break

    def _wider(self, name: str) -> tuple[LightMap | None, ...]:
        """Return the maps that go on where one ends, None where one of them is missing yet."""
        return {
            "far": (),
            "near": (self._far.shown,),
            "close": (self._near.shown, self._far.shown),
        }[name]

    def change(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> None:
        """Light another terrain from now on: what is shown stays until there are new maps.

        Parameters
        ----------
        terrain
            The other one.
        areas
            West, south, east, north (m): elsewhere its ground is the same.
        """
        self._maker.terrain = terrain
        self._maker.version += 1
        for _, layer in self._layers:
            layer.change(areas)

    def relight(self, sun: Sun) -> None:
        """Let another sun shine from now on: what is shown stays until there are new maps."""
        self._maker.sun = sun
        self._maker.version += 1

    def settle(self, camera: Camera) -> None:
        """Make and show all that a camera's picture needs at once."""
        near, far, close = self._squares(camera)
        squares = {"far": far, "near": near, "close": close}
        for name, layer in self._from_far:
            self._show(layer, squares[name], *self._wider(name))
        self.haze_base = self._haze_goal()
        self._haze_known = True

    def _show(
        self, layer: Layer, square: Square, behind: LightMap | None = None, beyond: LightMap | None = None
    ) -> None:
        if layer.shown is None or not self._is(layer.shown, square, behind):
            known = _alike(layer.shown, square)
            made = LightMap(self._maker, square, behind=behind, beyond=beyond, known=known)
            made.finish()
            layer.show(made)
        else:
            layer.show(layer.shown)

    def _squares(self, camera: Camera) -> tuple[Square, Square, Square]:
        extent, (x, y, _) = self._extent, camera.eye
        near, close = (
            Square.around(
                x + AHEAD * width * camera.forward[0],
                y + AHEAD * width * camera.forward[1],
                width=width,
                texels=self._texels,
            )
            for width in (NEAR * extent, CLOSE * extent)
        )
        return near, Square.around(x, y, width=FAR * extent, texels=self._texels // 2), close

    def _order(
        self, layer: Layer, square: Square, behind: LightMap | None = None, beyond: LightMap | None = None
    ) -> None:
        """Begin another map where neither the shown one nor a coming one is what is wanted.

        One that has been begun is made first, or a quick eye would never get any, unless it is of no use.
        """
        useless = layer.coming is not None and whole(layer.coming.square).meet(whole(square)).empty
        if layer.step in (1, 2, 3) or (layer.coming is not None and not useless):
            return
        wanted = not self._is(layer.shown, square, behind)
        if not wanted:
            layer.coming = None
            return
        known = _alike(layer.shown, square)
        layer.coming = LightMap(self._maker, square, behind=behind, beyond=beyond, known=known)

    def _is(self, made: LightMap | None, square: Square, behind: LightMap | None) -> bool:
        """Tell whether a map is what is wanted: of the ground as it is, under the sun as it stands."""
        wider = None if behind is None else (behind.square, behind.version)
        if made is None or made.outdated or made.sun != self._maker.sun:
            return False
        return made.square == square and made.behind == wider

    def _haze_goal(self) -> float:
        return self.haze_base if self._far.shown is None else self._far.shown.haze_base

    def _ease(self, elapsed: float) -> None:
        goal = self._haze_goal()
        if not self._haze_known:
            self._haze_known = self._far.shown is not None
            self.haze_base = goal
            return
        self.haze_base = _approach(self.haze_base, goal, elapsed * EASE)


def _approach(value: float, goal: float, step: float) -> float:
    return goal if abs(goal - value) <= step else value + float(np.copysign(step, goal - value))


def _alike(known: LightMap | None, square: Square) -> LightMap | None:
    return known if known is not None and known.square.texel == square.texel else None
