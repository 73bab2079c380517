"""What a camera sees along a flight, frame by frame, and what each frame took."""

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
    """What a frame took and showed."""

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
    """Draw what a camera sees along a flight, a frame for each of its views."""
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
        shoot = _complete if complete else _ready
        overlay = Overlay(context, terrain, renderer.stream) if overlays else None
        for number, camera in enumerate(cameras):
            shot = shoot(renderer, camera, framebuffer, elapsed=1.0 / fps, clock=number / fps)
            if overlay is not None:
                for name in overlays:
                    overlay.draw(name, camera.eye, framebuffer)
            yield shot, read_picture(texture) if pixels else None


def _cameras(views: CameraStates) -> list[Camera]:
    rows = zip(views.eye.tolist(), views.target.tolist(), views.fov.tolist(), strict=True)
    return [Camera(tuple(eye), tuple(target), fov=fov) for eye, target, fov in rows]


def _complete(
    renderer: Renderer, camera: Camera, framebuffer: moderngl.Framebuffer, *, elapsed: float, clock: float
) -> CapturedFrame:
    """Draw the picture that `render` gives, whatever there was before."""
    del elapsed
    start, ground = time.perf_counter(), renderer.stream
    before = renderer.timings.get("tiles", 0.0), ground.written
    renderer.prepare(camera, framebuffer.size)
    renderer.draw(camera, framebuffer, clock=clock)
    return CapturedFrame(
        seconds=time.perf_counter() - start,
        generation_seconds=renderer.timings["tiles"] - before[0],
        tiles_generated=ground.written - before[1],
        tiles_drawn=ground.tile_renderer.tiles,
        triangles=renderer.triangles,
        settled=True,
    )


def _ready(
    renderer: Renderer, camera: Camera, framebuffer: moderngl.Framebuffer, *, elapsed: float, clock: float
) -> CapturedFrame:
    """Draw what is ready, and a little more of it each time."""
    start = time.perf_counter()
    stats = renderer.frame(camera, framebuffer, elapsed=elapsed, clock=clock)
    return CapturedFrame(
        seconds=time.perf_counter() - start,
        generation_seconds=stats.generation_seconds,
        tiles_generated=stats.tiles_generated,
        tiles_drawn=stats.tiles_drawn,
        triangles=stats.triangles,
        settled=stats.settled,
    )
