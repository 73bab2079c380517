"""A flight over a sketch's terrain: drawn along a path, written as a film, and what it took."""

from __future__ import annotations

import statistics
from contextlib import closing, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sketchterrain.app.jobs import run_with_fallback
from sketchterrain.app.listings import device_entry
from sketchterrain.app.stills import sketch_weather
from sketchterrain.export.film import check_film, film
from sketchterrain.render.frame_capture import capture_frames
from sketchterrain.render.quality import Quality
from sketchterrain.render.tour import tour
from sketchterrain.terrain.building import build

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.app.progress import Stages
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.render.flight import CameraStates, Flight
    from sketchterrain.render.frame_capture import CapturedFrame
    from sketchterrain.render.sky import Weather
    from sketchterrain.terrain.terrain import Terrain

SECONDS = 20.0
"""Of a flight without a path, if nothing else is asked for."""


@dataclass(frozen=True)
class FlightOptions:
    """How a flight is taken."""

    size: tuple[int, int] = (1280, 720)
    fps: int = 30
    seconds: float | None = None
    quality: float | None = None
    real_time: bool = False
    overlays: tuple[str, ...] = ()
    hour: float | None = None
    clouds: float | None = None
    without: tuple[str, ...] = ()
    textures: Path | None = None


def fly(
    sketch: Sketch,
    flight: Flight | None,
    take: FlightOptions,
    *,
    output: Path | None,
    device: str | None,
    fast: bool,
    stages: Stages,
) -> dict[str, Any]:
    """Fly over a sketch's terrain."""
    Quality(without=frozenset(take.without))  # refuses now what there is not
    weather = sketch_weather(sketch, take.hour, take.clouds)

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> dict[str, Any]:
        if output is not None:
            check_film(output, size=take.size, frames=_frames(flight, take))
        with stages.stage("features", "Placing features"):
            terrain = build(sketch, device=context)
        with stages.stage("path", "Choosing a path"):
            views = _views(terrain, flight, take)
            lowest = _lowest(terrain, views)
        with stages.stage("frames", "Flying") as tell:
            shots = _shoot(terrain, views, take, weather, output, tell)
        seconds = stages.seconds | {"total": stages.elapsed}
        return {
            "sketch": sketch.name,
            "seed": sketch.seed,
            "size": {"width": take.size[0], "height": take.size[1]},
            "fps": take.fps,
            "seconds": len(shots) / take.fps,
            "lowest": lowest,
            "real_time": take.real_time,
            **_told(shots),
            "device": device_entry(context.device),
            "fast": context.fast,
            "restarts": list(restarts),
            "timings": {name: round(value, 4) for name, value in seconds.items()},
            "output": None if output is None else str(output),
        }

    return run_with_fallback(work, device=device, fast=fast, stages=stages)


def _frames(flight: Flight | None, take: FlightOptions) -> int:
    if flight is None:
        return max(1, round((take.seconds or SECONDS) * take.fps))
    return len(flight.times(take.fps, take.seconds))


def _views(terrain: Terrain, flight: Flight | None, take: FlightOptions) -> CameraStates:
    seconds = take.seconds
    if flight is None:
        seconds = seconds or SECONDS
        flight = tour(terrain, seconds=seconds)
    return flight.over(terrain.heights).at(flight.times(take.fps, seconds))


def _shoot(
    terrain: Terrain,
    views: CameraStates,
    take: FlightOptions,
    weather: Weather,
    output: Path | None,
    tell: Callable[[float], None],
) -> list[CapturedFrame]:
    frames = len(views.eye)
    writing = (
        nullcontext(_ignore) if output is None else film(output, size=take.size, fps=take.fps, frames=frames)
    )
    seen = capture_frames(
        terrain,
        views,
        fps=take.fps,
        size=take.size,
        weather=weather,
        textures=take.textures,
        quality=None if take.quality is None else Quality.from_level(take.quality),
        without=take.without,
        complete=not take.real_time,
        overlays=take.overlays,
        pixels=output is not None,
    )
    shots: list[CapturedFrame] = []
    with writing as add, closing(seen):
        for shot, picture in seen:
            shots.append(shot)
            if picture is not None:
                add(picture)
            tell(len(shots) / frames)
    return shots


def _ignore(_: npt.NDArray[np.uint8]) -> None:
    """Take a frame that nobody wants."""


def _lowest(terrain: Terrain, views: CameraStates) -> float:
    """Return how high above the ground (m) the eye is where it is lowest."""
    ground = terrain.heights(views.eye[:, 0], views.eye[:, 1])
    return float((views.eye[:, 2] - ground).min())


def _told(shots: Sequence[CapturedFrame]) -> dict[str, Any]:
    """Return what frames took, in the thesis's terms: what generation takes at first, and while updating."""
    updating = [shot.generation_seconds for shot in shots[1:] if shot.tiles_generated]
    seconds = [shot.seconds for shot in shots]
    triangles = [shot.triangles for shot in shots]
    return {
        "frames": len(shots),
        "settled": sum(shot.settled for shot in shots),
        "generation": {
            "initial": shots[0].generation_seconds,
            "updating_frames": len(updating),
            "mean": statistics.fmean(updating or [0.0]),
            "worst": max(updating, default=0.0),
            "tiles": sum(shot.tiles_generated for shot in shots),
        },
        "triangles": {"mean": statistics.fmean(triangles), "most": max(triangles)},
        "frame": {"mean": statistics.fmean(seconds), "worst": max(seconds)},
        "frames_per_second": len(shots) / sum(seconds),
    }
