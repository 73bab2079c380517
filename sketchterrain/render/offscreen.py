"""Offscreen rendering: single pictures, pictures of many terrains, frames of flights."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera
from sketchterrain.io.system import release_freed_memory
from sketchterrain.render.draped import check_method
from sketchterrain.render.overlays import Overlay, check_overlays
from sketchterrain.render.programs import ResourceCache, close_context, open_context, release_orphans
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.scenery import load_textures
from sketchterrain.render.sharing_probe import moved_to_context, open_device
from sketchterrain.render.sky import Weather, sun_for_view
from sketchterrain.render.views import check_view, find_view

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator, Sequence
    from pathlib import Path

    import moderngl
    import numpy.typing as npt

    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.generation.terrain import Terrain
    from sketchterrain.render.flight import CameraStates
    from sketchterrain.render.overlays import LegendEntry
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun

MAX_SIDE = 8192  # px


def render_picture(
    terrain: TerrainSource,
    *,
    size: tuple[int, int] = (1280, 720),
    camera: Camera | None = None,
    view: str = "auto",
    sun: Sun | None = None,
    weather: Weather | None = None,
    textures: Path | None = None,
    quality: Quality | None = None,
    clock: float = 0.0,
    overlays: Sequence[str] = (),
    legend: list[LegendEntry] | None = None,
    timings: dict[str, float] | None = None,
    drapes: Drapes | None = None,
    drape_method: str = "tiles",
) -> npt.NDArray[np.uint8]:
    """Return a picture of a terrain, (height, width, 3) sRGB, row 0 on top; deterministic for a driver.

    By default `find_view` chooses the camera for the view kind and the weather's hour sets the sun; `clock`
    (s) animates water, plants and clouds. Without `drapes` the sketch's are drawn. Overlays are drawn in the
    given order; `legend` and `timings` (s) are filled if given.
    """
    check_size(size)
    check_overlays(overlays)
    check_view(view)
    check_method(drape_method)
    start = time.perf_counter()
    camera, scene = _scene(terrain, camera, view=view, sun=sun, weather=weather, drapes=drapes)
    view_seconds = time.perf_counter() - start
    with canvas(size) as (context, texture, framebuffer):
        quality = quality or Quality.for_still(size)
        renderer = Renderer(
            context, terrain, textures=textures, quality=quality, drape_method=drape_method, **scene
        )
        renderer.prepare(camera, size)
        renderer.draw(camera, framebuffer, clock=clock, once=True)
        if overlays:
            overlay = Overlay(context, terrain, renderer.stream)
            for name in overlays:
                overlay.draw(name, camera.eye, framebuffer)
                if legend is not None:
                    legend += overlay.legend(name)
        picture = read_picture(texture)
        if timings is not None:
            timings.update({"view": view_seconds} | renderer.timings)
        return picture


def _scene(
    terrain: TerrainSource,
    camera: Camera | None = None,
    *,
    view: str = "auto",
    sun: Sun | None = None,
    weather: Weather | None = None,
    drapes: Drapes | None = None,
) -> tuple[Camera, dict[str, Any]]:
    """Return the camera, and sun, weather and drapes of its renderer: those given, else the sketch's."""
    weather, drapes = weather or Weather.from_sketch(terrain.sketch), drapes or open_drapes(terrain)
    if camera is None:
        framed = None if drapes is None or view != "layers" else drapes.shown_box
        camera = find_view(terrain, view, weather=weather, framed=framed)
    sun = sun or sun_for_view(terrain, camera, weather)
    return camera, {"sun": sun, "weather": weather, "drapes": drapes}


def open_drapes(terrain: TerrainSource) -> Drapes | None:
    """Return the draped layers of a terrain's sketch, None without any."""
    sketch = terrain.sketch
    if not sketch.drapes:
        return None
    from sketchterrain.drape.drapes import Drapes  # with readers of files

    return Drapes.open(sketch.drapes, sketch.frame, terrain.size, terrain.extent)


@contextmanager
def canvas(
    size: tuple[int, int],
) -> Iterator[tuple[moderngl.Context, moderngl.Texture, moderngl.Framebuffer]]:
    """Open a context with an RGBA texture and its framebuffer; close it on exit."""
    context = open_context()
    try:
        texture = context.texture(size, 4)
        yield context, texture, context.framebuffer([texture])
    finally:
        close_context(context)


def check_size(size: tuple[int, int]) -> None:
    """Raise InputError unless both sides are 16 to `MAX_SIDE` px."""
    width, height = size
    if not (16 <= width <= MAX_SIDE and 16 <= height <= MAX_SIDE):
        raise InputError(f"expected a picture of 16 to {MAX_SIDE} pixels a side, got {width}×{height}")


def read_picture(texture: moderngl.Texture) -> npt.NDArray[np.uint8]:
    """Return the pixels of an RGBA texture: (height, width, 3) uint8, row 0 on top."""
    width, height = texture.size
    pixels = np.frombuffer(texture.read(), np.uint8).reshape(height, width, 4)
    return np.ascontiguousarray(pixels[::-1, :, :3])


class SnapshotRenderer:
    """Renders the same bytes as `render_picture`, in less time, for one thread.

    Terrains may belong to another thread, which must not change them meanwhile: they are copied to a context
    of their device that shares buffers with this OpenGL context.
    """

    def __init__(self, size: tuple[int, int] = (1280, 720)) -> None:
        check_size(size)
        self._size = size
        self._context = open_context()
        # Objects must be deleted in this thread, not where Python collects them.
        self._context.gc_mode = "context_gc"
        self._texture = self._context.texture(size, 4)
        self._framebuffer = self._context.framebuffer([self._texture])
        self._resources = ResourceCache()
        self._compute: ComputeContext | None = None

    def load_textures(self, sketch: Sketch, device: object) -> None:
        """Load what pictures of a sketch need, before its terrain is known; see `scenery.load_textures`."""
        load_textures(self._context, sketch, device, Quality.for_still(self._size), self._resources)

    def picture(
        self,
        terrain: Terrain,
        *,
        view: str = "auto",
        weather: Weather | None = None,
        timings: dict[str, float] | None = None,
    ) -> npt.NDArray[np.uint8]:
        """Return a picture; see `render_picture`."""
        check_view(view)
        start = time.perf_counter()
        terrain = moved_to_context(terrain, self._own_context(terrain.context))
        camera, scene = _scene(terrain, view=view, weather=weather)
        view_seconds = time.perf_counter() - start
        try:
            quality, resources = Quality.for_still(self._size), self._resources.borrow()
            renderer = Renderer(self._context, terrain, quality=quality, resources=resources, **scene)
            renderer.prepare(camera, self._size)
            terrain.release_buffers()  # before drawing, which needs most
            release_freed_memory()
            renderer.draw(camera, self._framebuffer, once=True)
            picture = read_picture(self._texture)
            if timings is not None:
                timings.update({"view": view_seconds} | renderer.timings)
            renderer.release()
            return picture
        finally:
            renderer = None  # type: ignore[assignment]  # its objects are deleted next
            release_orphans(self._context)

    def close(self) -> None:
        """Release all resources and the context."""
        self._resources.close()
        release_orphans(self._context)
        close_context(self._context)

    def _own_context(self, context: ComputeContext) -> ComputeContext:
        """Return a context of the same device with its own queue: threads must not share one."""
        own = self._compute
        if own is None or (own.device, own.fast) != (context.device, context.fast):
            self._compute = own = open_device(context.device, real=context.real, fast=context.fast)
        return own


@dataclass(frozen=True)
class CapturedFrame:
    """Statistics of a captured frame."""

    seconds: float
    generation_seconds: float
    tiles_generated: int
    tiles_drawn: int
    triangles: int
    converged: bool


def capture_frames(
    terrain: TerrainSource,
    views: CameraStates,
    *,
    fps: float,
    size: tuple[int, int] = (1280, 720),
    weather: Weather | None = None,
    textures: Path | None = None,
    quality: Quality | None = None,
    without: Iterable[str] = (),
    complete: bool = True,
    overlays: Sequence[str] = (),
    pixels: bool = True,
    drapes: Drapes | None = None,
    drape_method: str = "tiles",
) -> Generator[tuple[CapturedFrame, npt.NDArray[np.uint8] | None]]:
    """Draw a frame for each camera state of a flight, 1/fps s apart; yield statistics and pixels.

    Complete frames equal `render_picture` but for steady labels; otherwise each frame shows what is ready
    within the budget, as in a viewer. Without `drapes` the sketch's are drawn. `without` leaves out more
    parts than the quality does; pixels are (height, width, 3) sRGB or, if not requested, None.
    """
    check_size(size)
    check_overlays(overlays)
    check_method(drape_method)
    with canvas(size) as (context, texture, framebuffer):
        if quality is None:
            quality = (
                Quality.for_still(size) if complete else Quality.for_renderer(context.info["GL_RENDERER"])
            )
        quality = replace(quality, without=quality.without | frozenset(without))
        cameras = views.cameras
        _, scene = _scene(terrain, cameras[0], weather=weather, drapes=drapes)
        renderer = Renderer(
            context, terrain, textures=textures, quality=quality, drape_method=drape_method, **scene
        )
        overlay = Overlay(context, terrain, renderer.stream) if overlays else None
        for number, camera in enumerate(cameras):
            elapsed, clock = 1.0 / fps, number / fps
            stats = _capture(renderer, camera, framebuffer, elapsed=elapsed, clock=clock, complete=complete)
            if overlay is not None:
                for name in overlays:
                    overlay.draw(name, camera.eye, framebuffer)
            yield stats, read_picture(texture) if pixels else None


def _capture(
    renderer: Renderer,
    camera: Camera,
    framebuffer: moderngl.Framebuffer,
    *,
    elapsed: float,
    clock: float,
    complete: bool,
) -> CapturedFrame:
    """Draw a complete picture, independent of earlier frames, or a frame within its time budget."""
    start, stream = time.perf_counter(), renderer.stream
    tile_seconds, written = renderer.timings.get("tiles", 0.0), stream.written
    if complete:
        renderer.prepare(camera, framebuffer.size, elapsed=elapsed)
        renderer.draw(camera, framebuffer, clock=clock)
        generation, converged = renderer.timings["tiles"] - tile_seconds, True
    else:
        stats = renderer.frame(camera, framebuffer, elapsed=elapsed, clock=clock)
        generation, converged = stats.generation_seconds, stats.converged
    return CapturedFrame(
        seconds=time.perf_counter() - start,
        generation_seconds=generation,
        tiles_generated=stream.written - written,
        tiles_drawn=stream.tile_renderer.tiles,
        triangles=renderer.scenery.triangles,
        converged=converged,
    )
