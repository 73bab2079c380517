"""What a camera sees along a flight, frame by frame, and what each frame took."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sketchterrain.render.camera import Camera, clip_planes
from sketchterrain.render.context import open_context
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.snapshot import check_size, read_picture
from sketchterrain.render.sunlight import find_sun

if TYPE_CHECKING:
    from collections.abc import Generator

    import moderngl
    import numpy as np
    import numpy.typing as npt

    from sketchterrain.render.flight import Views
    from sketchterrain.render.scene import Terrain

__all__ = ["Shot", "cameras_of", "footage"]

FARTHEST = 50.0  # extents


@dataclass(frozen=True)
class Shot:
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
        Whether nothing that it shows was still missing or moving.
    """

    seconds: float
    generation_seconds: float
    tiles_generated: int
    tiles_drawn: int
    triangles: int
    settled: bool


def cameras_of(terrain: Terrain, views: Views, *, reach: float) -> list[Camera]:
    """Return the cameras of views, with clipping planes that suit their heights above the ground.

    Parameters
    ----------
    terrain
        Whose ground.
    views
        Of a flight.
    reach
        How far the ground is drawn from near to it, in extents.
    """
    ground = terrain.heights(views.eye[:, 0], views.eye[:, 1])
    extent, cameras = terrain.extent, []
    for eye, target, fov, floor in zip(
        views.eye.tolist(), views.target.tolist(), views.fov.tolist(), ground.tolist(), strict=True
    ):
        clearance = max(eye[2] - floor, 0.0)
        near, far = clip_planes(clearance, min(reach * extent + 8.0 * clearance, FARTHEST * extent))
        cameras.append(Camera(tuple(eye), tuple(target), fov=fov, near=near, far=far))
    return cameras


def footage(
    terrain: Terrain,
    views: Views,
    *,
    fps: float,
    size: tuple[int, int] = (1280, 720),
    quality: Quality | None = None,
    complete: bool = True,
    pixels: bool = True,
) -> Generator[tuple[Shot, npt.NDArray[np.uint8] | None]]:
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
    quality
        What a frame may cost; by default the best if frames shall be complete, else what suits the device.
    complete
        Whether each frame shows all in full detail; else what is ready within its budget, as in a viewer.
    pixels
        Whether the frames are wanted, or only what they took.

    Yields
    ------
    Shot
        What the frame took.
    (height, width, 3) uint8 or None
        sRGB, row 0 on top.

    Raises
    ------
    InputError
        If the size is out of range.
    DeviceError
        If there is no OpenGL.
    """
    check_size(size)
    context = open_context()
    try:
        if quality is None:
            quality = Quality() if complete else Quality.for_renderer(context.info["GL_RENDERER"])
        cameras = cameras_of(terrain, views, reach=quality.reach)
        renderer = Renderer(context, terrain, sun=find_sun(terrain, cameras[0]), quality=quality)
        texture = context.texture(size, 4)
        framebuffer = context.framebuffer([texture])
        for number, camera in enumerate(cameras):
            shot = _shoot(renderer, camera, framebuffer, clock=number / fps, complete=complete)
            yield shot, read_picture(texture) if pixels else None
    finally:
        context.release()


def _shoot(
    renderer: Renderer, camera: Camera, framebuffer: moderngl.Framebuffer, *, clock: float, complete: bool
) -> Shot:
    start = time.perf_counter()
    renderer.prepare(camera, framebuffer.size)
    generation = time.perf_counter() - start
    renderer.draw(camera, framebuffer, clock=clock)
    return Shot(time.perf_counter() - start, generation, 0, 0, 0, settled=complete)
