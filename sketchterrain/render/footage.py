"""What a camera sees along a flight, frame by frame, and what each frame took."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sketchterrain.render.camera import Camera
from sketchterrain.render.overlays import Overlay, check_overlays
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.snapshot import canvas, check_size, read_picture
from sketchterrain.render.sunlight import sun_for_view
from sketchterrain.render.weather import Weather

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
    """What a frame took and showed.

    Attributes
    ----------
    seconds : float
        s, all of it, until it was drawn.
    generation_seconds : float
        s of that, for tiles.
    tiles_generated, tiles_drawn, triangles : int
        Of this frame.
    settled : bool
        Whether nothing was missing, and nothing but the camera and water moved.
    """

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
    """Draw what a camera sees along a flight, a frame for each of its views.

    Parameters
    ----------
    terrain
        What to draw.
    views
        Of a flight, at times 1/fps apart.
    fps
        Frames a second: water moves and tiles change by it, however long a frame takes.
    size
        Width and height in pixels, 16 to 8192 each.
    sun
        Where the sun stands; by default where it does at the weather's hour, for the first view.
    weather
        By default the sketch's.
    textures
        A folder of pictures that replace the program's own textures.
    quality
        What a frame may cost; by default the best if frames shall be complete, else what suits the device.
    without
        Parts of the picture that are left out, besides those that the quality leaves out.
    complete
        Whether each frame is the picture that `render_picture` gives; else it shows what is ready within its
        budget, as in a viewer.
    overlays
        Drawn over each frame in this order: names of ``OVERLAYS``.
    pixels
        Whether the frames are wanted, or only what they took.

    Yields
    ------
    CapturedFrame
        What the frame took.
    (height, width, 3) uint8 or None
        sRGB, row 0 on top.

    Raises
    ------
    InputError
        If the size is out of range, there is no such overlay or part, or the weather's hour is in the night.
    DeviceError
        If there is no OpenGL.
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
        shoot = _complete if complete else _ready
        overlay = Overlay(context, terrain, renderer.ground) if overlays else None
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
    start, ground = time.perf_counter(), renderer.ground
    before = renderer.timings.get("tiles", 0.0), ground.written
    renderer.prepare(camera, framebuffer.size)
    renderer.draw(camera, framebuffer, clock=clock)
    return CapturedFrame(
        seconds=time.perf_counter() - start,
        generation_seconds=renderer.timings["tiles"] - before[0],
        tiles_generated=ground.written - before[1],
        tiles_drawn=ground.pool.tiles,
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
