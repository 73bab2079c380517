"""The engine's renderer: an OpenGL context that follows the terrain and the view's state."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.render.overlays import OVERLAYS, Overlay
from sketchterrain.render.plant_meshes import all_plant_meshes
from sketchterrain.render.programs import open_context
from sketchterrain.render.quality import CPU_DRIVERS, Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Weather, find_sun, sun_for_view
from sketchterrain.render.targets import PictureTarget
from sketchterrain.ui.engine.protocol import SetDrapes, ViewState

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sketchterrain.array_types import Bounds
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.geometry.camera import Camera
    from sketchterrain.render.quality import FrameStats
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun

_BEST = 1.0  # quality of a view at rest
_DRAWING_THREADS = "llvmpipe-"
_NICENESS = 10  # about a tenth of the CPU under load


class ViewRenderer:
    """An OpenGL context, and the renderer and overlays of the current terrain."""

    def __init__(self) -> None:
        self._context = open_context()
        self.name = str(self._context.info["GL_RENDERER"])
        self.is_software = any(part in self.name.lower() for part in CPU_DRIVERS)
        if self.is_software:
            _lower_drawing_threads()
        all_plant_meshes()  # while the placer places the first terrain
        self._view = ViewState()
        self._renderer: Renderer | None = None
        self._still: Renderer | None = None  # of the best quality, for a view at rest
        self._still_terrain: TerrainSource | None = None
        self._still_areas: list[Bounds] = []  # in which that is out of date, m
        self._refinement: Iterator[None] | None = None
        self._overlay: Overlay | None = None
        self._terrain: TerrainSource | None = None
        self._drapes: Drapes | None = None  # None before the first draped layer
        self._held: tuple[int, int] | None = None
        self.sun: Sun | None = None  # None before the first terrain
        self._target = PictureTarget(self._context)

    @property
    def is_empty(self) -> bool:
        """Whether there is no renderer, before the first terrain or after an error."""
        return self._renderer is None

    @property
    def can_refine(self) -> bool:
        """Whether frames have less than the best quality."""
        return self._view.quality != _BEST

    @property
    def sharing(self) -> str:
        """How heights reach OpenGL; ``none`` before the first terrain."""
        return "none" if self._renderer is None else self._renderer.stream.memory.kind

    def set_view(self, view: ViewState) -> None:
        if (view.quality, view.drape_method) != (self._view.quality, self._view.drape_method):
            self.clear()
        self._view = view

    def set_drapes(self, message: SetDrapes) -> None:
        """Show other draped layers; files that are known are not read again."""
        if self._drapes is None and not message.layers:
            return
        from sketchterrain.drape.drapes import Drapes

        place, known = (message.frame, message.size, message.extent), self._drapes
        if known is None or (known.frame, known.size, known.extent) != place:
            known = Drapes.open((), *place)
        self._drapes = known.updated(message.layers)
        self._held, self._refinement = message.held, None
        for renderer in (self._renderer, self._still):
            if renderer is not None:
                renderer.set_drapes(self._drapes, held=self._held)

    def clear(self) -> None:
        """Release the renderer; the next `set_terrain` creates another one."""
        renderers, self._renderer, self._still = (self._renderer, self._still), None, None
        self._refinement = self._overlay = self._terrain = self._still_terrain = self.sun = None
        self._still_areas = []
        for renderer in renderers:
            if renderer is not None:
                renderer.release()

    def set_terrain(self, terrain: TerrainSource, areas: list[Bounds], camera: Camera) -> str:
        """Display a terrain that differs from the previous one in areas (m); return a warning or nothing."""
        weather = Weather.from_sketch(terrain.sketch)
        kept = self._terrain
        if kept is not None and (
            kept.extent != terrain.extent or kept.sketch.materials != terrain.sketch.materials
        ):
            self.clear()
        before, self._terrain = self._terrain, terrain
        if self._renderer is None or before is None:
            self.sun, line = _find_sun(terrain, camera, weather)
            number = self._view.quality
            quality = Quality.for_renderer(self.name) if number is None else Quality.from_level(number)
            self._renderer = self._open_renderer(terrain, self.sun, weather, quality)
            return line
        line = ""
        self._refinement = None
        self._still_areas += areas
        if areas or terrain.sketch.looks != before.sketch.looks:
            self._renderer.set_terrain(terrain, areas)
            if self._overlay is not None:
                self._overlay.set_terrain(terrain, areas)
        old = Weather.from_sketch(before.sketch)
        if (weather.hour, weather.latitude) != (old.hour, old.latitude):
            self.sun, line = _find_sun(terrain, camera, weather)
        if weather != old:
            assert self.sun is not None  # noqa: S101 # set with the renderer
            self._renderer.relight(sun=self.sun, weather=weather)
        return line

    def _open_renderer(
        self, terrain: TerrainSource, sun: Sun, weather: Weather, quality: Quality
    ) -> Renderer:
        method = self._view.drape_method
        renderer = Renderer(
            self._context, terrain, sun=sun, weather=weather, quality=quality, drape_method=method
        )
        if self._drapes is not None:
            renderer.set_drapes(self._drapes, held=self._held)
        return renderer

    def draw(
        self,
        camera: Camera,
        *,
        elapsed: float,
        clock: float,
        budget: float | None = None,
        hasty: bool = False,
    ) -> FrameStats:
        """Draw a frame; see `Renderer.frame` and `read_pixels`."""
        renderer, terrain = self._renderer, self._terrain
        assert renderer is not None and terrain is not None  # noqa: S101, PT018 # `set_terrain` was called
        self._refinement = None
        framebuffer = self._target.sized((self._view.width, self._view.height))
        stats = renderer.frame(camera, framebuffer, elapsed=elapsed, clock=clock, budget=budget, hasty=hasty)
        self._draw_overlays(camera)
        return stats

    def load(self, camera: Camera, *, elapsed: float, budget: float) -> bool:
        """Load what frames at rest show, within a budget (s); return whether it is complete."""
        assert self._renderer is not None  # noqa: S101 # as in `draw`
        size = self._view.width, self._view.height
        return self._renderer.load(camera, size, elapsed=elapsed, budget=budget)

    def refine(self, camera: Camera, *, clock: float) -> bool:
        """Continue a picture of the best quality by a part; return whether it is complete; see `read_pixels`.

        The camera, terrain and view must be the same from part to part; `draw` and `set_terrain` end it.
        """
        if self._refinement is None:
            self._refinement = self._refined(camera, clock)
        for _ in self._refinement:
            return False
        self._refinement = None
        self._draw_overlays(camera)
        return True

    def _refined(self, camera: Camera, clock: float) -> Iterator[None]:
        terrain, sun = self._terrain, self.sun
        assert terrain is not None and sun is not None  # noqa: S101, PT018 # `set_terrain` was called
        weather = Weather.from_sketch(terrain.sketch)
        size = self._view.width, self._view.height
        if self._still is None:
            self._still = self._open_renderer(terrain, sun, weather, Quality.for_still(size))
        elif terrain is not self._still_terrain:
            self._still.stream.draws = None  # or its tiles would be rewritten at once, not in parts
            self._still.set_terrain(terrain, self._still_areas)
        self._still_terrain, self._still_areas = terrain, []
        self._still.relight(sun=sun, weather=weather)
        yield
        framebuffer = self._target.sized(size)
        yield from self._still.refined(camera, framebuffer, clock=clock)

    def _draw_overlays(self, camera: Camera) -> None:
        framebuffer = self._target.sized((self._view.width, self._view.height))
        assert self._renderer is not None and self._terrain is not None  # noqa: S101, PT018 # as in `draw`
        for name in [name for name in self._view.overlays if name in OVERLAYS]:
            if self._overlay is None:
                self._overlay = Overlay(self._context, self._terrain, self._renderer.stream)
            self._overlay.draw(name, camera.eye, framebuffer)

    def read_pixels(self, into: memoryview) -> None:
        """Copy the last frame: RGBX, row 0 on top."""
        self._target.read_into(into)


def _lower_drawing_threads() -> None:
    """Lower the priority of a software renderer's threads below placement and computation."""
    if sys.platform == "linux":
        for thread in Path("/proc/self/task").glob("*"):
            if (thread / "comm").read_text(encoding="ascii", errors="replace").startswith(_DRAWING_THREADS):
                os.setpriority(os.PRIO_PROCESS, int(thread.name), _NICENESS)


def _find_sun(terrain: TerrainSource, camera: Camera, weather: Weather) -> tuple[Sun, str]:
    """Return the sun; at night, one that suits the view, and a line that says so."""
    try:
        return sun_for_view(terrain, camera, weather), ""
    except InputError as error:
        return find_sun(terrain, camera), one_line(error)
