"""The flight as the renderer draws it: times of frames, and of what is new in them against the budget."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.flight_scene import RATE, stops
from sketchterrain.benchmarks.outcome import Column, Row, Table
from sketchterrain.errors import DeviceError
from sketchterrain.render.context import close_context, open_context
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sunlight import find_sun

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.render.budgets import FrameStats
    from sketchterrain.terrain.terrain import Terrain

SHARE_WITHIN = 99.0
"""% of the frames with new tiles that are to make them within the budget; all within twice it."""

_COLUMNS = (
    Column("opengl", "OpenGL"),
    Column("frames", "frames"),
    Column("median_ms", "frame, median, ms"),
    Column("p95_ms", "95 %, ms"),
    Column("worst_ms", "worst, ms"),
    Column("budget_ms", "budget, ms"),
    Column("generation_ms", "tiles of a frame that has new ones, ms"),
    Column("worst_generation_ms", "worst, ms"),
    Column("within_budget", "within the budget, %"),
    Column("asked", "asked, %"),
    Column("within_twice", "within twice it, %"),
    Column("new_within", "tiles, light and plants within it, %"),
    Column("triangles", "triangles"),
    Column("note", "note"),
)


@dataclass(frozen=True)
class _Frames:
    name: str
    quality: Quality
    seconds: npt.NDArray[np.float64]
    stats: tuple[FrameStats, ...]


def frames(terrain: Terrain, effort: Effort) -> Table:
    """Draw the flight at the quality that suits the driver, from a complete first picture on."""
    title = "Frames as drawn, {} × {}".format(*effort.flight_size)
    try:
        found = _drawn(terrain, effort)
    except DeviceError as error:
        return Table(title, _COLUMNS, ({"opengl": "absent", "note": str(error)},))
    return Table(title, _COLUMNS, (_row(found),))


def _drawn(terrain: Terrain, effort: Effort) -> _Frames:
    path = stops(terrain, effort.flight_frames + 1, seconds=effort.flight_frames / RATE)
    gl = open_context()
    try:
        name = str(gl.info["GL_RENDERER"])
        quality = Quality.for_renderer(name)
        renderer = Renderer(gl, terrain, sun=find_sun(terrain, path[0].camera), quality=quality)
        framebuffer = gl.framebuffer([gl.texture(effort.flight_size, 4)])
        renderer.prepare(path[0].camera, effort.flight_size)
        seconds, stats = [], []
        for number, stop in enumerate(path):
            start = perf_counter()
            stats.append(renderer.frame(stop.camera, framebuffer, elapsed=1.0 / RATE, clock=number / RATE))
            gl.finish()
            seconds.append(perf_counter() - start)
    finally:
        close_context(gl)
    return _Frames(name, quality, np.array(seconds[1:]), tuple(stats[1:]))


def _row(found: _Frames) -> Row:
    name, quality = found.name, found.quality
    generation = np.array([each.generation_seconds for each in found.stats if each.tiles_generated])
    new = np.array(
        [each.generation_seconds + each.light_seconds + each.plant_seconds for each in found.stats]
    )
    some = generation if generation.size else np.zeros(1)
    median, p95 = np.percentile(found.seconds, [50, 95])
    return {
        "opengl": name,
        "frames": len(found.seconds),
        "median_ms": float(median) * 1e3,
        "p95_ms": float(p95) * 1e3,
        "worst_ms": float(found.seconds.max()) * 1e3,
        "budget_ms": quality.budget * 1e3,
        "generation_ms": float(some.mean()) * 1e3,
        "worst_generation_ms": float(some.max()) * 1e3,
        "within_budget": 100.0 * float(np.mean(some <= quality.budget)),
        "asked": SHARE_WITHIN,
        "within_twice": 100.0 * float(np.mean(some <= 2 * quality.budget)),
        "new_within": 100.0 * float(np.mean(new <= quality.budget)),
        "triangles": round(float(np.mean([each.triangles for each in found.stats]))),
        "note": None,
        "seconds": found.seconds.tolist(),
        "generation_seconds": [each.generation_seconds for each in found.stats],
        "new_seconds": new.tolist(),
        "triangles_each": [each.triangles for each in found.stats],
    }
