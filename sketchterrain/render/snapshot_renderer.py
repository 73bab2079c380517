"""Offscreen rendering of many terrains with one OpenGL context and shared resources."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from sketchterrain.render.context import close_context, open_context, release_orphans
from sketchterrain.render.programs import ResourceCache
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sharing_probe import moved_to_context, open_device
from sketchterrain.render.sky import Weather
from sketchterrain.render.snapshot import check_size, read_picture
from sketchterrain.render.sunlight import sun_for_view
from sketchterrain.render.views import check_view, find_view

if TYPE_CHECKING:
    from types import TracebackType

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.terrain import Terrain


class SnapshotRenderer:
    """Takes pictures as :func:`render_picture` does: the same bytes, in less time.

    All of it belongs to the thread that opened it. Terrains may be another thread's: a copy of them is put on
    the same device beside this one's OpenGL, and whoever made them must not change them meanwhile.
    """

    def __init__(self, size: tuple[int, int] = (1280, 720)) -> None:
        check_size(size)
        self._size = size
        self._context = open_context()
        # Objects must be deleted in this thread, not where Python collects them.
        self._context.gc_mode = "context_gc"
        self._texture = self._context.texture(size, 4)
        self._framebuffer = self._context.framebuffer([self._texture])
        self._kept = ResourceCache()
        self._device: ComputeContext | None = None

    def __enter__(self) -> SnapshotRenderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

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
        terrain = moved_to_context(terrain, self._beside(terrain.context))
        weather = weather or Weather.from_sketch(terrain.sketch)
        camera = find_view(terrain, view, weather=weather)
        sun = sun_for_view(terrain, camera, weather)
        spent = {"view": time.perf_counter() - start}
        try:
            renderer = Renderer(
                self._context, terrain, sun=sun, weather=weather, resources=self._kept.borrow()
            )
            renderer.prepare(camera, self._size)
            renderer.draw(camera, self._framebuffer)
            picture = read_picture(self._texture)
            if timings is not None:
                timings.update(spent | renderer.timings)
            renderer.release()
            return picture
        finally:
            renderer = None  # type: ignore[assignment]  # its objects are deleted next
            release_orphans(self._context)

    def close(self) -> None:
        """Release all resources and the context."""
        self._kept.close()
        release_orphans(self._context)
        close_context(self._context)

    def _beside(self, context: ComputeContext) -> ComputeContext:
        """Return a context of the same device with its own queue: threads must not share one."""
        known = self._device
        if known is None or (known.device, known.fast) != (context.device, context.fast):
            self._device = known = open_device(context.device, real=context.real, fast=context.fast)
        return known
