"""Films of flights over a sketch's terrain, with their frame statistics."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sketchterrain.app.jobs import run_with_fallback
from sketchterrain.app.listings import device_entry
from sketchterrain.app.progress import Stages
from sketchterrain.app.stills import sketch_weather
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.export.film import check_film, film
from sketchterrain.render.flight import CameraStates, Flight
from sketchterrain.render.offscreen import CapturedFrame, capture_frames
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Weather
from sketchterrain.render.tour import tour
from sketchterrain.terrain.building import build
from sketchterrain.terrain.terrain import Terrain

SECONDS = 20.0
"""Default duration of a flight without a path."""


@dataclass(frozen=True)
class FlightOptions:
    """How to film a flight; by default all of the path, complete frames, in the sketch's weather."""

    size: tuple[int, int] = (1280, 720)  # width, height (px)
    fps: int = 30
    seconds: float | None = None
    quality: float | None = None  # 0 … 1; by default the best, or in real time what suits the device
    real_time: bool = False  # draw frames within a time budget, as a viewer does
    overlays: tuple[str, ...] = ()
    hour: float | None = None
    clouds: float | None = None
    without: tuple[str, ...] = ()
    textures: Path | None = None


def fly(
    sketch: Sketch,
    flight: Flight | None,
    options: FlightOptions,
    *,
    output: Path | None,
    device: str | None,
    fast: bool,
    stages: Stages,
) -> dict[str, Any]:
    """Film a flight, by default a tour of the sketch, to a folder or file, if any; return the JSON report."""
    Quality(without=frozenset(options.without))  # refuses unknown parts before any work
    weather = sketch_weather(sketch, options.hour, options.clouds)
    seconds = options.seconds or (SECONDS if flight is None else None)

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> dict[str, Any]:
        if output is not None:
            count = round((seconds or SECONDS) * options.fps)
            frame_count = max(1, count) if flight is None else len(flight.times(options.fps, seconds))
            check_film(output, size=options.size, frames=frame_count)
        with stages.stage("features", "Placing features"):
            terrain = build(sketch, device=context)
        with stages.stage("path", "Choosing a path"):
            path = tour(terrain, seconds=seconds or SECONDS) if flight is None else flight
            views = path.with_absolute_heights(terrain.heights).at(path.times(options.fps, seconds))
            clearance = views.eye[:, 2] - terrain.heights(views.eye[:, 0], views.eye[:, 1])
        with stages.stage("frames", "Flying") as progress:
            frames = _capture(terrain, views, options, weather, output, progress)
        timings = stages.seconds | {"total": stages.elapsed}
        return {
            "sketch": sketch.name,
            "seed": sketch.seed,
            "size": {"width": options.size[0], "height": options.size[1]},
            "fps": options.fps,
            "seconds": len(frames) / options.fps,
            "lowest": float(clearance.min()),
            "real_time": options.real_time,
            **_statistics(frames),
            "device": device_entry(context.device),
            "fast": context.fast,
            "restarts": list(restarts),
            "timings": {name: round(value, 4) for name, value in timings.items()},
            "output": None if output is None else str(output),
        }

    return run_with_fallback(work, device=device, fast=fast, stages=stages)


def _capture(
    terrain: Terrain,
    views: CameraStates,
    options: FlightOptions,
    weather: Weather,
    output: Path | None,
    progress: Callable[[float], None],
) -> list[CapturedFrame]:
    count = len(views.eye)
    captured = capture_frames(
        terrain,
        views,
        fps=options.fps,
        size=options.size,
        weather=weather,
        textures=options.textures,
        quality=None if options.quality is None else Quality.from_level(options.quality),
        without=options.without,
        complete=not options.real_time,
        overlays=options.overlays,
        pixels=output is not None,
    )
    frames: list[CapturedFrame] = []
    with ExitStack() as stack:
        write = None
        if output is not None:
            write = stack.enter_context(film(output, size=options.size, fps=options.fps, frames=count))
        stack.enter_context(closing(captured))
        for frame, picture in captured:
            frames.append(frame)
            if write is not None and picture is not None:
                write(picture)
            progress(len(frames) / count)
    return frames


def _statistics(frames: Sequence[CapturedFrame]) -> dict[str, Any]:
    """Return frame statistics in the thesis's terms: generation at first, and while updating."""
    updating = [frame.generation_seconds for frame in frames[1:] if frame.tiles_generated]
    seconds = [frame.seconds for frame in frames]
    triangles = [frame.triangles for frame in frames]
    return {
        "frames": len(frames),
        "settled": sum(frame.settled for frame in frames),
        "generation": {
            "initial": frames[0].generation_seconds,
            "updating_frames": len(updating),
            "mean": statistics.fmean(updating or [0.0]),
            "worst": max(updating, default=0.0),
            "tiles": sum(frame.tiles_generated for frame in frames),
        },
        "triangles": {"mean": statistics.fmean(triangles), "most": max(triangles)},
        "frame": {"mean": statistics.fmean(seconds), "worst": max(seconds)},
        "frames_per_second": len(frames) / sum(seconds),
    }
