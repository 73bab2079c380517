"""Offscreen rendering of single pictures."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.render.context import close_context, open_context
from sketchterrain.render.overlays import Overlay, check_overlays
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Weather
from sketchterrain.render.sunlight import sun_for_view
from sketchterrain.render.views import check_view, find_view

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    import moderngl
    import numpy.typing as npt

    from sketchterrain.render.camera import Camera
    from sketchterrain.render.overlays import LegendEntry
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun

LARGEST = 8192
"""Largest width and height (px)."""


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
    overlays: Sequence[str] = (),
    legend: list[LegendEntry] | None = None,
    timings: dict[str, float] | None = None,
) -> npt.NDArray[np.uint8]:
    """Return a picture of a terrain, (height, width, 3) sRGB, row 0 on top; deterministic for a driver.

    By default `find_view` chooses the camera for the view kind and the weather's hour sets the sun. Overlays
    are drawn in the given order; `legend` and `timings` (s) are filled if given.
    """
    check_size(size)
    check_overlays(overlays)
    check_view(view)
    start = time.perf_counter()
    weather = weather or Weather.from_sketch(terrain.sketch)
    camera = camera or find_view(terrain, view, weather=weather)
    sun = sun or sun_for_view(terrain, camera, weather)
    spent = {"view": time.perf_counter() - start}
    with canvas(size) as (context, texture, framebuffer):
        renderer = Renderer(context, terrain, sun=sun, weather=weather, textures=textures, quality=quality)
        renderer.prepare(camera, size)
        renderer.draw(camera, framebuffer)
        if overlays:
            overlay = Overlay(context, terrain, renderer.stream)
            for name in overlays:
                overlay.draw(name, camera.eye, framebuffer)
                if legend is not None:
                    legend += overlay.legend(name)
        picture = read_picture(texture)
        if timings is not None:
            timings.update(spent | renderer.timings)
        return picture


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
    """Raise InputError unless both sides are 16 to `LARGEST` px."""
    width, height = size
    if not (16 <= width <= LARGEST and 16 <= height <= LARGEST):
        raise InputError(f"expected a picture of 16 to {LARGEST} pixels a side, got {width}×{height}")


def read_picture(texture: moderngl.Texture) -> npt.NDArray[np.uint8]:
    """Return the pixels of an RGBA texture: (height, width, 3) uint8, row 0 on top."""
    width, height = texture.size
    pixels = np.frombuffer(texture.read(), np.uint8).reshape(height, width, 4)
    return np.ascontiguousarray(pixels[::-1, :, :3])
