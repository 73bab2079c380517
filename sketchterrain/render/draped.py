"""Draped layers drawn into a buffer of the picture's size, and how they share the work with painted tiles.

Two-step draping: layers are drawn on a smooth approximation of the ground, then read at each pixel's foot.
Step 1 draws them, as tiles of their own have them, with the picture's own view on squares around the eye,
into a buffer of the picture's size. Step 2 projects, for each pixel, the point of the approximation below or
above its ground the same way. Where that is outside of the buffer, or hidden by nearer parts of the
approximation, nothing shows.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.appearance import AppearanceTextures
from sketchterrain.render.draped_geometry import DrapedGeometry, DrapedView, Held, mesh_of
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.lit_ground import GroundLighting
from sketchterrain.render.programs import (
    bind_textures,
    build_program,
    clamped,
    fullscreen_pass,
    set_uniforms,
)
from sketchterrain.render.quality import UNLIMITED, Quality, TimeBudget
from sketchterrain.render.targets import DrapedBuffer, RenderTargets, averaging_pass
from sketchterrain.tiles.lod import CameraView, inside_frustum
from sketchterrain.tiles.tile_pool import TilePool

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes

FADE: Final = 0.2
"""s in which a feature that is taken hold of, or released, changes from one method to another."""


SCREEN_METHODS: Final = ("two-step", "geometry")
"""Methods besides ``tiles``."""


def check_method(method: str) -> None:
    """Raise InputError for an unknown method of draping."""
    if method not in (known := ("auto", "tiles", *SCREEN_METHODS)):
        raise InputError(f"expected a method of draping, one of {', '.join(known)}, got {method!r}")


class DrapedScreen:
    """Draws what tiles don't show: all layers in other methods, and the feature that is held for editing.

    `painted` is what tiles of the ground are to show, or None; `seconds` counts the time of drawing.
    """

    def __init__(
        self,
        context: moderngl.Context,
        stream: TerrainStream,
        lit: GroundLighting,
        quality: Quality,
        method: str,
    ) -> None:
        check_method(method)
        # Painted tiles are the nearest to exact coverage at any height, and cost nothing while the eye rests.
        self.method = "tiles" if method == "auto" else method
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
    def screen(self) -> TwoStepDraping | DrapedGeometry | None:
        """The method that draws all layers, None for tiles."""
        if self.method == "two-step":
            return TwoStepDraping(self._context, self._stream, self._lit, self._quality)
        if self.method == "geometry":
            return DrapedGeometry(self._context, self._stream, samples=self._quality.samples)
        return None

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
        loaded = not isinstance(self.screen, TwoStepDraping) or self.screen.painted.converged
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

    def update(self, view: CameraView, pool: TilePool, budget: TimeBudget = UNLIMITED) -> bool:
        """Paint tiles of the two-step method, as `AppearanceTextures.update`."""
        return not isinstance(self.screen, TwoStepDraping) or self.screen.painted.update(view, pool, budget)

    def draw(self, camera: Camera, targets: RenderTargets, pixel: float) -> None:
        """Draw over the G-buffer with the frame's camera; `pixel` is the angle (rad) of a pixel."""
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
            if isinstance(screen, TwoStepDraping) and self._shows_rest:
                screen.draw(view, targets, self._buffer)
            elif isinstance(screen, DrapedGeometry) and rest is not None and self._shows_rest:
                screen.draw(rest, view, targets)
            for version, feature, share in held:
                self.geometry.draw(version, view, targets, held=feature, share=share)
        finally:
            self._buffer.resolve(targets.depth)
        self.seconds += time.perf_counter() - start

    def _set_painted(self) -> None:
        if self._share == 1.0 or self._rest is None:  # until then tiles show the held feature as it was
            self.painted = self._rest if self.method == "tiles" else None
            if isinstance(self.screen, TwoStepDraping):
                self.screen.painted.set_drapes(self._rest)


QUADS: Final = 16  # along the side of a square of the approximation
RING: Final = 8  # squares along the side of a level, whose middle half is left to the next finer one
LEAST: Final = 4.0  # m, least width of squares
SMOOTH: Final = 128.0  # cells of the approximation in an extent, about


class TwoStepDraping:
    """Draws layers, as `painted` has them in tiles, into a cleared buffer of the picture's size."""

    def __init__(
        self, context: moderngl.Context, stream: TerrainStream, lit: GroundLighting, quality: Quality
    ) -> None:
        self._context, self._lit, self._extent = context, lit, stream.tiles.extent
        self.painted = AppearanceTextures(context, stream.terrain, quality, over_land=False)
        self._macros = {"TILE_QUADS": QUADS, "SAMPLES": quality.samples}
        self._foot = fullscreen_pass(context, "draped_foot.frag.glsl", defines=self._macros)
        self._indices = context.buffer(mesh_of(QUADS, 0).numbers.astype(np.uint32).tobytes())
        self._instances = context.buffer(reserve=12, dynamic=True)
        self._mesh: tuple[Mapping[str, int | str], moderngl.VertexArray] | None = None
        self._first: moderngl.Framebuffer | None = None

    @property
    def nbytes(self) -> int:
        """Bytes of buffers and caches."""
        first = 12 * self._first.width * self._first.height if self._first else 0
        return self.painted.nbytes + first

    def draw(self, view: DrapedView, targets: RenderTargets, buffer: DrapedBuffer) -> None:
        """Draw all layers."""
        camera, size = view.camera, targets.size
        if self._first is None or self._first.size != size:
            self._colour = clamped(self._context.texture(size, 4, dtype="f2"))
            self._depth = self._context.depth_texture(size)
            self._depth.compare_func = ""
            self._first = self._context.framebuffer([self._colour], self._depth)
        mesh, squares = self._current_mesh(), self._squares(camera, size[0] / size[1])
        textures = {"drawn": self._colour, "smooth_depth": self._depth, "ground_depth": targets.depth}
        levels = list[float]()
        for name in ("near", "far"):
            textures[f"{name}_heights"], texel = self._lit.height_maps[name]
            levels.append(max(float(np.log2(self._extent / SMOOTH / texel)), 0.0))
        units = bind_textures({**textures, **self.painted.textures}) | {"smooth_levels": tuple(levels)}
        units |= self.painted.uniforms(camera.eye)
        set_uniforms(mesh.program, units)
        set_uniforms(self._foot.program, units)
        self._instances.orphan(squares.nbytes)
        self._instances.write(squares.tobytes())
        self._first.use()
        self._first.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        mesh.render(moderngl.TRIANGLES, instances=len(squares))
        buffer.clear()
        self._foot.render(vertices=3)

    def _current_mesh(self) -> moderngl.VertexArray:
        """Return squares of the approximation with a program for what is painted."""
        defines = self.painted.defines
        if self._mesh is None or self._mesh[0] != defines:
            names, macros = ("draped_smooth.vert.glsl", "draped_painted.frag.glsl"), self._macros | defines
            program = build_program(self._context, *names, defines=macros)
            array = self._context.vertex_array(
                program, [(self._instances, "3f4/i", "square")], index_buffer=self._indices
            )
            self._mesh = defines, array
        return self._mesh[1]

    def _squares(self, camera: Camera, aspect: float) -> Float32Array:
        """Return west and north (m from the eye) and the quads' width (m) of squares in view, (n, 3).

        They become wider with their distance, level by level.
        """
        eye, planes = np.array(camera.eye), camera.frustum(aspect)
        above = max(eye[2] - self._lit.height_at(*camera.eye[:2]), 0.0)
        width, found = 2.0 ** np.ceil(np.log2(max(LEAST, above / RING))), list[Float64Array]()
        places = np.stack(np.meshgrid(np.arange(RING), np.arange(RING)), axis=-1).reshape(-1, 2)
        while not found or 0.25 * RING * width < camera.far:
            corner = 2.0 * np.round(0.5 * eye[:2] / width) - RING // 2
            middle = np.round(eye[:2] / width) - RING // 4 - corner
            is_finer = ((places >= middle) & (places < middle + RING // 2)).all(axis=1)
            low = np.insert((corner + places[~is_finer if found else ...]) * width, 2, 0.0, axis=1)
            low[:, 2], high_z = self._lit.height_range
            high = low + width
            high[:, 2] = high_z
            seen = inside_frustum(planes, low, high)
            rows = np.stack(
                [low[:, 0] - eye[0], high[:, 1] - eye[1], np.full(len(low), width / QUADS)], axis=1
            )
            found.append(rows[seen])
            width *= 2.0
        return np.concatenate(found).astype(np.float32)
