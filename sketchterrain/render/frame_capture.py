"""Frame capture along a flight, with statistics of each frame."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sketchterrain.render.camera import Camera
from sketchterrain.render.overlays import Overlay, check_overlays
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Weather
from sketchterrain.render.snapshot import canvas, check_size, read_picture
from sketchterrain.render.sunlight import sun_for_view

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Sequence
    from pathlib import Path

    import moderngl
    import numpy as np
    import numpy.typing as npt

    from sketchterrain.render.flight import CameraStates
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun


@dataclass(frozen=True)
class CapturedFrame:
    """Statistics of a captured frame."""

    seconds: float
    generation_seconds: float
    tiles_generated: int
    tiles_drawn: int
    triangles: int
    settled: bool


def capture_frames(
    terrain: TerrainSource,
    views: CameraStates,
    *,
    fps: float,
    size: tuple[int, int] = (1280, 720),
    sun: Sun | None = None,
    weather: Weather | None = None,
    textures: Path | None = None,
    quality: Quality | None = None,
    without: Iterable[str] = (),
    complete: bool = True,
    overlays: Sequence[str] = (),
    pixels: bool = True,
) -> Generator[tuple[CapturedFrame, npt.NDArray[np.uint8] | None]]:
    """Draw a frame for each camera state of a flight, 1/fps s apart; yield statistics and pixels.

    Complete frames equal `render_picture`; otherwise each frame shows what is ready within the budget, as in
    a viewer. `without` leaves out more parts than the quality does; pixels are (height, width, 3) sRGB or, if
    not requested, None.
    """
    check_size(size)
    check_overlays(overlays)
    with canvas(size) as (context, texture, framebuffer):
        if quality is None:
            quality = Quality() if complete else Quality.for_renderer(context.info["GL_RENDERER"])
        quality = replace(quality, without=quality.without | frozenset(without))
        cameras = _cameras(views)
        weather = weather or Weather.from_sketch(terrain.sketch)
        sun = sun or sun_for_view(terrain, cameras[0], weather)
        renderer = Renderer(context, terrain, sun=sun, weather=weather, textures=textures, quality=quality)
        overlay = Overlay(context, terrain, renderer.stream) if overlays else None
        for number, camera in enumerate(cameras):
            elapsed, clock = 1.0 / fps, number / fps
            stats = _capture(renderer, camera, framebuffer, elapsed=elapsed, clock=clock, complete=complete)
            if overlay is not None:
                for name in overlays:
                    overlay.draw(name, camera.eye, framebuffer)
            yield stats, read_picture(texture) if pixels else None


def _cameras(views: CameraStates) -> list[Camera]:
    rows = zip(views.eye.tolist(), views.target.tolist(), views.fov.tolist(), strict=True)
    return [Camera(tuple(eye), tuple(target), fov=fov) for eye, target, fov in rows]


def _capture(
    renderer: Renderer,
    camera: Camera,
    framebuffer: moderngl.Framebuffer,
    *,
    elapsed: float,
    clock: float,
    complete: bool,
) -> CapturedFrame:
    """Draw a complete picture, independent of earlier frames, or what is ready within a frame's budget."""
    start, stream = time.perf_counter(), renderer.stream
    tile_seconds, written = renderer.timings.get("tiles", 0.0), stream.written
    if complete:
        renderer.prepare(camera, framebuffer.size)
        renderer.draw(camera, framebuffer, clock=clock)
        generation, settled = renderer.timings["tiles"] - tile_seconds, True
    else:
        stats = renderer.frame(camera, framebuffer, elapsed=elapsed, clock=clock)
        generation, settled = stats.generation_seconds, stats.settled
    return CapturedFrame(
        seconds=time.perf_counter() - start,
        generation_seconds=generation,
        tiles_generated=stream.written - written,
        tiles_drawn=stream.tile_renderer.tiles,
        triangles=renderer.triangles,
        settled=settled,
    )
