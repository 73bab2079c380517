"""What the engine draws: a renderer that follows the terrain and the view, and a picture for each frame."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sketchterrain.errors import InputError, one_line
from sketchterrain.render import Quality, Renderer, Weather, open_context
from sketchterrain.render.overlays import OVERLAYS, Overlay
from sketchterrain.render.picture_target import PictureTarget
from sketchterrain.render.quality import SOFTWARE
from sketchterrain.render.sharing_probe import open_device
from sketchterrain.render.sunlight import find_sun, sun_for_view
from sketchterrain.ui.engine.protocol import ViewState

if TYPE_CHECKING:
    from sketchterrain.compute import ComputeContext, Device
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun
    from sketchterrain.render.stats import FrameStats
    from sketchterrain.terrain.changes import Box

_DRAWING_THREADS = "llvmpipe-"
_NICE = 10
"""Of the system's priorities, 0 to 19: about a tenth of the time where all want it."""


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a renderer was made for."""

    renderer: Renderer
    overlay: Overlay | None
    terrain: TerrainSource
    sun: Sun


class ViewRenderer:
    """An OpenGL context and what is drawn in it."""

    def __init__(self) -> None:
        self._context = open_context()
        self.name = str(self._context.info["GL_RENDERER"])
        self.is_software = any(part in self.name.lower() for part in SOFTWARE)
        if self.is_software:
            _step_back()
        self._view = ViewState()
        self._shown: _Shown | None = None
        self._target = PictureTarget(self._context)

    def open_device(self, device: Device) -> ComputeContext:
        """Open a device so that it writes where this context draws from."""
        return open_device(device)

    @property
    def is_empty(self) -> bool:
        """Whether nothing is drawn yet, or any more."""
        return self._shown is None

    @property
    def sharing(self) -> str:
        """How heights get here; ``none`` before anything is drawn."""
        return "none" if self._shown is None else self._shown.renderer.stream.memory.kind

    @property
    def sun(self) -> Sun | None:
        """Where the sun stands; None before anything is drawn."""
        return None if self._shown is None else self._shown.sun

    def look(self, view: ViewState) -> None:
        """Show things otherwise from now on."""
        if view.quality != self._view.quality:
            self.clear()
        self._view = view

    def clear(self) -> None:
        """Forget what is drawn; the next `show` makes all of it anew."""
        shown, self._shown = self._shown, None
        if shown is not None:
            shown.renderer.release()

    def show(self, terrain: TerrainSource, areas: list[Box], camera: Camera) -> str:
        """Draw a terrain from now on."""
        shown = self._shown
        weather = Weather.from_sketch(terrain.sketch)
        if shown is not None and shown.terrain.extent != terrain.extent:
            self.clear()
            shown = None
        if shown is None:
            sun, line = _sun(terrain, camera, weather)
            renderer = Renderer(self._context, terrain, sun=sun, weather=weather, quality=self._quality())
            self._shown = _Shown(renderer, None, terrain, sun)
            return line
        sun, line = shown.sun, ""
        before = shown.terrain.sketch
        if areas or terrain.sketch.look != before.look:
            shown.renderer.set_terrain(terrain, areas)
            if shown.overlay is not None:
                shown.overlay.set_terrain(terrain, areas)
        old = Weather.from_sketch(before)
        if (weather.hour, weather.latitude) != (old.hour, old.latitude):
            sun, line = _sun(terrain, camera, weather)
        if weather != old:
            shown.renderer.relight(sun=sun, weather=weather)
        self._shown = _Shown(shown.renderer, shown.overlay, terrain, sun)
        return line

    def frame(self, camera: Camera, *, elapsed: float, clock: float) -> FrameStats:
        """Draw a frame; `pixels` has it."""
        shown, framebuffer = self._shown, self._target.sized((self._view.width, self._view.height))
        assert shown is not None  # noqa: S101 # `show` was called before
        stats = shown.renderer.frame(camera, framebuffer, elapsed=elapsed, clock=clock)
        names = [name for name in self._view.overlays if name in OVERLAYS]
        if names and shown.overlay is None:
            shown = _Shown(
                shown.renderer,
                Overlay(self._context, shown.terrain, shown.renderer.stream),
                shown.terrain,
                shown.sun,
            )
            self._shown = shown
        for name in names:
            assert shown.overlay is not None  # noqa: S101 # made just now
            shown.overlay.draw(name, camera.eye, framebuffer)
        return stats

    def pixels(self, into: memoryview) -> None:
        """Copy the last frame: RGBX, row 0 on top."""
        self._target.read_into(into)

    def _quality(self) -> Quality:
        number = self._view.quality
        return Quality.for_renderer(self.name) if number is None else Quality.from_level(number)


def _step_back() -> None:
    """Let the threads of a driver that draws on the CPU come after those that place and compute."""
    if sys.platform == "linux":
        for thread in Path("/proc/self/task").glob("*"):
            if (thread / "comm").read_text(encoding="ascii", errors="replace").startswith(_DRAWING_THREADS):
                os.setpriority(os.PRIO_PROCESS, int(thread.name), _NICE)


def _sun(terrain: TerrainSource, camera: Camera, weather: Weather) -> tuple[Sun, str]:
    """Return where the sun stands; at night, where it would suit the view, and a line that says so."""
    try:
        return sun_for_view(terrain, camera, weather), ""
    except InputError as error:
        return find_sun(terrain, camera), one_line(error)
