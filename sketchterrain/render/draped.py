"""Draped layers drawn into a buffer of the picture's size, and how they share the work with painted tiles."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Final, Protocol

import moderngl

from sketchterrain.errors import InputError
from sketchterrain.render.camera import Camera
from sketchterrain.render.draped_geometry import DrapedGeometry, DrapedView, Held
from sketchterrain.render.draped_two_step import TwoStepDraping
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.lit_ground import GroundLighting
from sketchterrain.render.quality import Quality
from sketchterrain.render.targets import DrapedBuffer, RenderTargets, averaging_pass

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes

FADE: Final = 0.2
"""s in which a feature that is taken hold of, or released, changes from one method to another."""


class ScreenMethod(Protocol):
    """A way to draw all layers into a buffer of the picture's size."""

    is_loaded: bool  # whether the last picture had everything

    @property
    def nbytes(self) -> int:
        """Bytes of buffers and caches."""

    def draw(
        self, drapes: Drapes, view: DrapedView, targets: RenderTargets, buffer: DrapedBuffer, *, moving: bool
    ) -> None:
        """Draw into the cleared buffer with the frame's camera; `moving` limits the time of loading."""


ScreenMethods = dict[str, Callable[[moderngl.Context, TerrainStream, GroundLighting, Quality], ScreenMethod]]
SCREEN_METHODS: Final[ScreenMethods] = {
    "two-step": lambda context, stream, lit, quality: TwoStepDraping(
        context, lit, stream.tiles.extent, samples=quality.samples
    ),
    "geometry": lambda context, stream, _, quality: DrapedGeometry(context, stream, samples=quality.samples),
}
"""Methods besides ``tiles`` by name; benchmarks add others."""


def check_method(method: str) -> None:
    """Raise InputError for an unknown method of draping."""
    if method not in (known := ("auto", "tiles", *SCREEN_METHODS)):
        raise InputError(f"expected a method of draping, one of {', '.join(known)}, got {method!r}")


def choose(method: str) -> str:
    """Return the method that draws layers; raise InputError for an unknown one.

    Painted tiles are the nearest to exact coverage at any height, and cost nothing while the eye rests.
    """
    check_method(method)
    return "tiles" if method == "auto" else method


class DrapedScreen:
    """Draws what tiles don't show: all layers in other methods, and the feature that is held for editing.

    Layers of blend modes other than normal are drawn as normal. `painted` is what tiles are to show, or None;
    `seconds` counts the time of drawing.
    """

    def __init__(
        self,
        context: moderngl.Context,
        stream: TerrainStream,
        lit: GroundLighting,
        quality: Quality,
        method: str,
    ) -> None:
        self.method = choose(method)
        self.painted: Drapes | None = None
        self.seconds = 0.0
        self._context, self._stream, self._lit, self._quality = context, stream, lit, quality
        self._drapes: Drapes | None = None
        self._rest: Drapes | None = None  # without the held feature
        self._held: Held | None = None
        self._share = 1.0  # of the held feature
        self._released: tuple[Drapes, Held, float] | None = None  # and its share
        self._buffer: DrapedBuffer | None = None  # of the last picture, if anything is in it

    @cached_property
    def _average(self) -> moderngl.VertexArray:
        return averaging_pass(self._context, samples=self._quality.samples)

    @cached_property
    def geometry(self) -> DrapedGeometry:
        """Geometry on the drawn triangles."""
        return DrapedGeometry(self._context, self._stream, samples=self._quality.samples)

    @cached_property
    def screen(self) -> ScreenMethod | None:
        """The method that draws all layers, None for tiles."""
        make = SCREEN_METHODS.get(self.method)
        return make and make(self._context, self._stream, self._lit, self._quality)

    @property
    def nbytes(self) -> int:
        """Bytes of buffers and caches."""
        used = (vars(self).get(name) for name in ("geometry", "screen", "_buffer"))
        return sum(each.nbytes for each in used if each is not None)

    @property
    def _shows_rest(self) -> bool:
        """Whether a method draws layers into the buffer."""
        return self.screen is not None and self._rest is not None and not self._rest.is_empty

    @property
    def converged(self) -> bool:
        """Whether all is loaded, and no feature is on its way from one method to another."""
        loaded = self.screen is None or not self._shows_rest or self.screen.is_loaded
        return loaded and self._share == 1.0 and self._released is None

    @property
    def textures(self) -> dict[str, moderngl.Texture]:
        """The buffer by the name of its sampler, if anything was drawn into it."""
        return {"draped": self._buffer.colour} if self._buffer else {}

    def set_drapes(self, drapes: Drapes | None, held: Held | None) -> None:
        """Replace the layers; `held` is left out of the tiles as soon as it is drawn by geometry."""
        if held != self._held and self.method == "tiles":
            if self._held is not None and self._drapes is not None and drapes is not None:
                self._released = (self._drapes, self._held, 1.0)  # the new ones may be without it
            self._share = 1.0 if held is None else 0.0
        self._drapes, self._held = drapes, held
        self._rest = None if drapes is None else drapes.without(held)
        self._set_painted()

    def settle(self) -> None:
        """End all fades: the next picture is a still."""
        self._share, self._released = 1.0, None
        self._set_painted()

    def advance(self, elapsed: float, *, tiles_converged: bool) -> None:
        """Advance fades by a frame time (s); a released feature stays until tiles show it."""
        if self._released is not None and tiles_converged and self._share == 1.0:
            drapes, held, share = self._released
            share -= elapsed / FADE
            self._released = (drapes, held, share) if share > 0.0 else None
        if self._share < 1.0:
            self._share = min(self._share + elapsed / FADE, 1.0)
            self._set_painted()

    def draw(self, camera: Camera, targets: RenderTargets, pixel: float, *, moving: bool) -> None:
        """Draw over the G-buffer with the frame's camera.

        `pixel` is the angle (rad) of a pixel; `moving` limits the time of loading.
        """
        drapes, rest, screen = self._drapes, self._rest, self.screen
        held = [] if drapes is None or self._held is None else [(drapes, self._held, self._share)]
        held += [self._released] if self._released else []
        if not held and not self._shows_rest:
            self._buffer = None
            return
        start, view = time.perf_counter(), DrapedView(camera, pixel)
        if self._buffer is None or self._buffer.size != targets.size:
            self._buffer = DrapedBuffer(self._context, targets.size, self._average)
        self._buffer.clear()
        try:
            if screen is not None and rest is not None and self._shows_rest:
                screen.draw(rest, view, targets, self._buffer, moving=moving)
            for version, feature, share in held:
                self.geometry.draw(version, view, targets, held=feature, share=share)
        finally:
            self._buffer.resolve(targets.depth)
        self.seconds += time.perf_counter() - start

    def _set_painted(self) -> None:
        if self._share == 1.0 or self._rest is None:  # until then tiles show the held feature as it was
            self.painted = self._rest if self.method == "tiles" else None
