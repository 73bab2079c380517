"""Draped layers drawn into a buffer of the picture's size, and how they share the work with painted tiles.

Two-step draping: layers are drawn on a smooth approximation of the ground, then read at each pixel's foot.
Step 1 draws them with the picture's own view, on squares of a quadtree around the eye, into a buffer of the
picture's size. Step 2 projects, for each pixel, the point of the approximation below or above its ground the
same way. Where that is outside of the buffer, or hidden by nearer parts of the approximation, nothing shows.
Rasters lie below vectors, whatever their order.
"""

from __future__ import annotations

import time
from functools import cached_property
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Int64Array
from sketchterrain.errors import InputError
from sketchterrain.render.appearance import premultiplied
from sketchterrain.render.camera import Camera
from sketchterrain.render.draped_cutting import mesh_of
from sketchterrain.render.draped_geometry import (
    DrapedGeometry,
    DrapedView,
    FeatureCutter,
    Held,
    PartBuffers,
    Squares,
)
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.lit_ground import GroundLighting
from sketchterrain.render.programs import build_program, clamped, fullscreen_pass, set_uniforms
from sketchterrain.render.quality import Quality
from sketchterrain.render.targets import DrapedBuffer, RenderTargets, averaging_pass
from sketchterrain.terrain.orthophotos import ROOTS, WHITE
from sketchterrain.tiles.lod import inside_frustum
from sketchterrain.tiles.quadtree import Boxes

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.drape.raster_source import DrapedRaster

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
        samples = self._quality.samples
        if self.method == "two-step":
            return TwoStepDraping(self._context, self._lit, self._stream.tiles.extent, samples=samples)
        if self.method == "geometry":
            return DrapedGeometry(self._context, self._stream, samples=samples)
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


QUADS: Final = 16  # along the side of a square
TEXELS: Final = 256  # along the side of a window of a raster: at most a pixel wide
WINDOWS: Final = 112  # in memory: 29 MB
COARSER: Final = 1.25  # factor on widths while there are more squares than that
MORE_LEVELS: Final = 24  # levels above a window, of others that show instead
LEAST: Final = 4.0  # m, least width of squares
SMOOTH: Final = 128.0  # cells of the approximation in an extent, about
LOADING: Final = 0.02  # s a frame for windows, in motion
_ROOTS: Final = 9  # squares around the eye that are divided
_CHILDREN: Final = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]])
_SQUARE: Final = np.dtype([("square", "<f4", 4), ("window", "<f4", 3)])
_FORMAT: Final = ("4f4 3f4/i", "square", "window")
ROOT_BYTES: Final = np.rint(255.0 * np.sqrt(WHITE) * ROOTS).astype(np.uint8)
"""√albedo of a byte of sRGB, as tiles have it."""


class TwoStepDraping:
    """Draws all layers of a version into a cleared buffer of the picture's size.

    `is_loaded` is whether the last picture had all windows of its rasters.
    """

    def __init__(
        self, context: moderngl.Context, lit: GroundLighting, extent: float, *, samples: int
    ) -> None:
        self._context, self._lit, self._extent = context, lit, extent
        macros = {"TILE_QUADS": QUADS, "SAMPLES": 1, "SMOOTH": 1}
        self._foot = fullscreen_pass(context, "draped_foot.frag.glsl", defines={**macros, "SAMPLES": samples})
        indices = context.buffer(mesh_of(QUADS, 0).numbers.astype(np.uint32).tobytes())
        self._instances = context.buffer(reserve=_SQUARE.itemsize * WINDOWS, dynamic=True)
        instances = (self._instances, *_FORMAT)
        self._ground, self._rasters = (
            context.vertex_array(
                build_program(context, "draped_smooth.vert.glsl", f"{name}.frag.glsl", defines=macros),
                [instances],
                index_buffer=indices,
                skip_errors=True,
            )
            for name in ("nothing", "draped_raster")
        )
        self._features = build_program(
            context, "draped_geometry.vert.glsl", "draped_geometry.frag.glsl", defines=macros
        )
        self._parts = PartBuffers(context, self._features, instances)
        self._windows: RasterWindows | None = None
        self._colour: moderngl.Texture | None = None
        self._cutter = FeatureCutter()
        self.is_loaded = True

    @property
    def nbytes(self) -> int:
        """Bytes of buffers and caches."""
        first = 12 * self._colour.width * self._colour.height if self._colour else 0
        windows = self._windows.nbytes if self._windows else 0
        return self._cutter.nbytes + self._parts.nbytes + windows + first

    def draw(
        self, drapes: Drapes, view: DrapedView, targets: RenderTargets, buffer: DrapedBuffer, *, moving: bool
    ) -> None:
        """Draw all layers; `moving` limits the time of loading."""
        size, eye = targets.size, view.camera.eye
        colour = self._resized(size)
        above = max(eye[2] - self._lit.height_at(*eye[:2]), 0.0)
        rasters = drapes.rasters(view.pixel * above)
        most = max(WINDOWS // max(len(rasters), 1), _ROOTS)  # all have room for their windows
        squares, codes = self._squares(view, size[0] / size[1], above, most)
        self._bind()
        rows = np.zeros(len(codes), _SQUARE)
        west, north = squares.boxes[:, 0], squares.boxes[:, 3]
        rows["square"][:, 0], rows["square"][:, 1] = west - eye[0], north - eye[1]
        rows["square"][:, 2] = (squares.boxes[:, 2] - west) / QUADS
        self._depth_only.use()
        self._depth_only.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._draw_squares(self._ground, rows)
        buffer.clear()
        self._depth.use(3)
        self.is_loaded = True
        for number, source in rasters:
            windows = self._windows = self._windows or RasterWindows(self._context, self._extent)
            self.is_loaded &= windows.find(source, codes, rows, LOADING if moving else np.inf)
            windows.texture.use(6)
            set_uniforms(self._rasters.program, {"windows": 6, "share": drapes.layers[number]["opacity"]})
            self._draw_squares(self._rasters, rows)
        if found := self._cutter.cut(drapes, None, squares):
            self._parts.write(found, drapes.styles)
            self._write_instances(rows)
            set_uniforms(self._features, {"share": 1.0})
            self._parts.array.render_indirect(self._parts.commands, moderngl.TRIANGLES, count=len(found))
        buffer.resolve(targets.depth, self._first)
        buffer.clear()
        targets.depth.use(4)
        colour.use(5)
        set_uniforms(self._foot.program, {"ground_depth": 4, "drawn": 5, "smooth_depth": 3})
        self._foot.render(vertices=3)

    def _resized(self, size: tuple[int, int]) -> moderngl.Texture:
        if self._colour is None or self._colour.size != size:
            self._colour = clamped(self._context.texture(size, 4, dtype="f2"))
            self._depth = self._context.depth_texture(size)
            self._depth.compare_func = ""
            self._first = self._context.framebuffer([self._colour])
            self._depth_only = self._context.framebuffer(depth_attachment=self._depth)
        return self._colour

    def _bind(self) -> None:
        """Bind the approximation."""
        levels = []
        for unit, name in enumerate(("near", "far"), 1):
            texture, texel = self._lit.height_maps[name]
            texture.use(unit)
            levels.append(max(float(np.log2(self._extent / SMOOTH / texel)), 0.0))
        units = {"near_heights": 1, "far_heights": 2, "ground_depth": 3, "smooth_levels": tuple(levels)}
        for program in (self._features, self._ground.program, self._rasters.program, self._foot.program):
            set_uniforms(program, units)

    def _squares(
        self, view: DrapedView, aspect: float, above: float, most: int
    ) -> tuple[Squares, Int64Array]:
        """Return the squares that a camera sees, and their levels, columns and rows from north to south."""
        widest, codes = TEXELS * view.pixel, np.zeros((most + 1, 3), np.int64)
        while len(codes) > most:
            codes = self._codes(view.camera, aspect, widest, above)
            widest *= COARSER
        cases = np.zeros(len(codes), np.int64)
        keys = [*map(tuple, codes.tolist())]
        return Squares.seen(keys, self._boxes(codes), QUADS, cases, view), codes

    def _boxes(self, codes: Int64Array) -> Boxes:
        low_z, high_z = self._lit.height_range
        width = self._extent * np.exp2(-codes[:, :1].astype(np.float64))
        low = codes[:, 1:] * width
        return Boxes(np.insert(low, 2, low_z, axis=1), np.insert(low + width, 2, high_z, axis=1))

    def _codes(self, camera: Camera, aspect: float, widest: float, above: float) -> Int64Array:
        """Return the squares that a camera sees, at most `widest` times their distance wide."""
        eye, top = np.array(camera.eye), int(np.ceil(np.log2(2.0 * camera.far / self._extent)))
        around = np.floor(eye[:2] / (self._extent * 2.0**top)).astype(np.int64)
        columns, rows = np.meshgrid(around[0] + np.arange(-1, 2), around[1] + np.arange(-1, 2))
        codes, found = np.stack([np.full(_ROOTS, -top), columns.ravel(), rows.ravel()], axis=1), []
        while len(codes):
            width, (low, high) = self._extent * 2.0 ** -codes[0, 0], self._boxes(codes)
            apart = np.linalg.norm(np.maximum(np.maximum(low - eye, eye - high), 0.0)[:, :2], axis=1)
            seen = inside_frustum(camera.frustum(aspect), low, high) & (apart < camera.far)
            splits = seen & (width > np.maximum(widest * np.hypot(apart, 0.5 * above), LEAST))
            found.append(codes[seen & ~splits])
            finer = (codes[splits] * [1, 2, 2] + [1, 0, 0])[:, None] + _CHILDREN
            codes = finer.reshape(-1, 3)
        return np.concatenate(found)

    def _draw_squares(self, array: moderngl.VertexArray, rows: npt.NDArray[np.void]) -> None:
        self._write_instances(rows)
        array.render(moderngl.TRIANGLES, instances=len(rows))

    def _write_instances(self, rows: npt.NDArray[np.void]) -> None:
        self._instances.orphan()
        self._instances.write(rows.tobytes())


class RasterWindows:
    """Windows of rasters on squares of the quadtree, in a texture array, the least recently used evicted."""

    def __init__(self, context: moderngl.Context, extent: float) -> None:
        self.texture = clamped(context.texture_array((TEXELS, TEXELS, WINDOWS), 4))
        self.nbytes = 4 * TEXELS * TEXELS * WINDOWS
        self._extent = extent
        self._slots: dict[object, int] = {}  # by window, the least recently used first

    def find(
        self, source: DrapedRaster, codes: Int64Array, rows: npt.NDArray[np.void], seconds: float
    ) -> bool:
        """Write layers of squares' windows, -1 for none, and places in them; return whether all are right.

        Windows are read for so many seconds; meanwhile wider ones show.
        """
        end, complete = time.perf_counter() + seconds, True
        # The finest level of which the source has as many pixels.
        finest = int(np.ceil(np.log2(self._extent / (TEXELS * source.pixel))))
        rows["square"][:, 3] = -1.0
        for number, (level, column, row) in enumerate(codes.tolist()):
            up = max(level - finest, 0)
            key = (source, level - up, column >> up, row >> up)
            if key not in self._slots and time.perf_counter() < end:
                self._read(source, key)
            while key not in self._slots and up < MORE_LEVELS:
                complete, up = False, up + 1
                key = (source, level - up, column >> up, row >> up)
            if key in self._slots:
                self._slots[key] = slot = self._slots.pop(key)
                share = 2.0**-up
                west, north = column * share - (column >> up), (row >> up) + 1 - (row + 1) * share
                rows["square"][number, 3], rows["window"][number] = slot, (west, north, share)
        return complete

    def _read(self, source: DrapedRaster, key: tuple[object, int, int, int]) -> None:
        _, level, column, row = key
        width = self._extent * 2.0**-level
        pixels = source.pixels(column * width, (row + 1) * width, width / TEXELS, TEXELS, TEXELS)
        free = len(self._slots) if len(self._slots) < WINDOWS else self._slots.pop(next(iter(self._slots)))
        pixels = np.dstack([ROOT_BYTES[pixels[..., :3]], pixels[..., 3]])
        self.texture.write(premultiplied(pixels).tobytes(), viewport=(0, 0, free, TEXELS, TEXELS, 1))
        self._slots[key] = free
