"""Commands `render` and `fly`: pictures, maps and films of a sketch's terrain."""

import statistics
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import device_entry
from sketchterrain.document.sketch import Sketch
from sketchterrain.export.files import prepare_folder
from sketchterrain.export.film import check_film, film
from sketchterrain.export.map.sheet import write_map
from sketchterrain.export.rasters import write_picture
from sketchterrain.generation.building import TERRAIN_KERNELS
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.camera import Camera
from sketchterrain.io.console import Stages, print_note
from sketchterrain.jobs.export import DeviceFallback, build_terrain, noted_drapes
from sketchterrain.render import scene
from sketchterrain.render.flight import CameraStates, Flight
from sketchterrain.render.offscreen import CapturedFrame, capture_frames, render_picture
from sketchterrain.render.overlays import LegendEntry, check_overlays
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Weather, sun_at
from sketchterrain.render.views import check_view, tour

Point = tuple[float, float, float]
_SIZE = (1280, 720)  # px, of pictures


@dataclass(frozen=True)
class SceneOptions:
    """Light and content of pictures and films; by default in the sketch's weather."""

    size: tuple[int, int] | None = None  # width, height (px)
    hour: float | None = None  # in place of the sketch's, as sky and clouds
    sky: str | None = None
    clouds: float | None = None
    quality: float | None = None  # 0 … 1; by default the best, or in real time what suits the device
    without: tuple[str, ...] = ()
    overlays: tuple[str, ...] = ()
    textures: Path | None = None
    drape_method: str = "auto"


@dataclass(frozen=True)
class PictureOptions(SceneOptions):
    """The same and the camera of a picture; of a map only the size counts."""

    eye: Point | None = None  # m; without it a view is found
    look_at: Point | None = None
    view: str = "auto"
    top_down: bool = False  # a map


def sketch_weather(
    sketch: Sketch, hour: float | None = None, sky: str | None = None, clouds: float | None = None
) -> Weather:
    """Return a sketch's weather, with another hour, sky or clouds if given; raise InputError at night."""
    weather = Weather.from_sketch(sketch, hour=hour, sky=sky, clouds=clouds)
    if weather.hour is not None:
        sun_at(weather.hour, weather.latitude)
    return weather


def render_to_file(
    sketch: Sketch, path: Path, options: PictureOptions, *, device: str | None, fast: bool, stages: Stages
) -> list[LegendEntry]:
    """Render a sketch's terrain to a .png, or a map to an .svg too; return the legend of the overlays."""
    check_picture(options)
    weather = sketch_weather(sketch, options.hour, options.sky, options.clouds)
    prepare_folder(path.parent)

    def work(context: ComputeContext, _: tuple[str, ...]) -> list[LegendEntry]:
        kernels = ("terrain.cl", "points.cl") if options.top_down else TERRAIN_KERNELS
        terrain = build_terrain(sketch, context, stages, kernels=kernels)
        with stages.stage("picture", "Drawing the map" if options.top_down else "Rendering"):
            if options.top_down:
                write_map(path, terrain, size=options.size, drapes=noted_drapes(terrain))
                return []
            return draw_picture(path, terrain, options, weather)

    return DeviceFallback(device, fast=fast).run(work, stages=stages)


def check_picture(options: PictureOptions) -> Quality:
    """Return the quality of a picture; raise InputError for unknown overlays, views or parts."""
    check_overlays(options.overlays)
    check_view(options.view)
    return Quality.from_level(1.0 if options.quality is None else options.quality, without=options.without)


def draw_picture(
    path: Path, terrain: scene.TerrainSource, options: PictureOptions, weather: Weather
) -> list[LegendEntry]:
    """Render a terrain to a .png; return the legend of the overlays."""
    legend: list[LegendEntry] = []
    picture = render_picture(
        terrain,
        size=options.size or _SIZE,
        camera=_camera(terrain, options.eye, options.look_at),
        view=options.view,
        weather=weather,
        textures=options.textures,
        quality=check_picture(options),
        overlays=options.overlays,
        legend=legend,
        drapes=noted_drapes(terrain),
        drape_method=options.drape_method,
    )
    write_picture(path, picture)
    return legend


def _camera(terrain: scene.TerrainSource, eye: Point | None, target: Point | None) -> Camera | None:
    """Return the camera of `--eye` and `--look-at`, None without an eye; print a note if underground."""
    if eye is None:
        return None
    west, south, east, north = scene.visible_rectangle(terrain)
    x, y = (west + east) / 2, (south + north) / 2
    if abs(eye[0] - x) + abs(eye[1] - y) < 0.02 * terrain.extent:  # looks north by default
        y += terrain.extent / 2
    middle, ground = (float(z) for z in terrain.heights([x, eye[0]], [y, eye[1]]))
    if eye[2] < ground:
        print_note(f"the eye is {ground - eye[2]:.1f} m under the ground")
    return Camera(eye, target or (x, y, middle))


SECONDS = 20.0
"""Default duration of a flight without a path."""


@dataclass(frozen=True)
class FlightOptions(SceneOptions):
    """The same and how to film a flight; by default all of the path, complete frames."""

    size: tuple[int, int] = _SIZE
    fps: int = 30
    seconds: float | None = None
    real_time: bool = False  # draw frames within a time budget, as a viewer does


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
    weather = sketch_weather(sketch, options.hour, options.sky, options.clouds)
    seconds = options.seconds or (SECONDS if flight is None else None)

    def work(context: ComputeContext, restarts: tuple[str, ...]) -> dict[str, Any]:
        if output is not None:
            count = round((seconds or SECONDS) * options.fps)
            frame_count = max(1, count) if flight is None else len(flight.times(options.fps, seconds))
            check_film(output, size=options.size, frames=frame_count)
        terrain = build_terrain(sketch, context, stages, kernels=(*TERRAIN_KERNELS, "terrain.cl"))
        with stages.stage("path", "Choosing a path"):
            path = tour(terrain, seconds=seconds or SECONDS) if flight is None else flight
            surface = partial(scene.surface_heights, terrain)
            views = path.with_absolute_heights(surface).at(path.times(options.fps, seconds))
            clearance = views.eye[:, 2] - surface(views.eye[:, 0], views.eye[:, 1])
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

    return DeviceFallback(device, fast=fast).run(work, stages=stages)


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
        drapes=noted_drapes(terrain),
        drape_method=options.drape_method,
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
        "settled": sum(frame.converged for frame in frames),
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
