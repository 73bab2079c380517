"""One still of a sketch's terrain: a picture, or a map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sketchterrain.app.arguments import camera_from_options
from sketchterrain.app.jobs import run_with_fallback
from sketchterrain.export.files import prepare_folder
from sketchterrain.export.map.sheet import write_map
from sketchterrain.export.rasters import write_picture
from sketchterrain.render.overlays import check_overlays
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Weather
from sketchterrain.render.snapshot import render_picture
from sketchterrain.render.sunlight import sun_at
from sketchterrain.render.views import check_view
from sketchterrain.terrain.building import build

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.app.arguments import Point
    from sketchterrain.app.progress import Stages
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.render import scene
    from sketchterrain.render.overlays import LegendEntry


@dataclass(frozen=True)
class PictureOptions:
    """How a picture is taken."""

    size: tuple[int, int] | None = None
    eye: Point | None = None
    look_at: Point | None = None
    view: str = "auto"
    hour: float | None = None
    clouds: float | None = None
    quality: float = 1.0
    without: tuple[str, ...] = ()
    overlays: tuple[str, ...] = ()
    textures: Path | None = None
    top_down: bool = False


def sketch_weather(sketch: scene.Sketch, hour: float | None, clouds: float | None) -> Weather:
    """Return a sketch's weather, with an hour and clouds in place of its own if they are given."""
    weather = Weather.from_sketch(sketch, hour=hour, clouds=clouds)
    if weather.hour is not None:
        sun_at(weather.hour, weather.latitude)  # now, not when all else is done
    return weather


def render_to_file(
    sketch: Sketch, path: Path, still: PictureOptions, *, device: str | None, fast: bool, stages: Stages
) -> list[LegendEntry]:
    """Draw a sketch's terrain and write it."""
    check_overlays(still.overlays)
    check_view(still.view)
    quality = Quality.from_level(still.quality, without=still.without)
    weather = sketch_weather(sketch, still.hour, still.clouds)

    def work(context: ComputeContext, _: tuple[str, ...]) -> list[LegendEntry]:
        with stages.stage("features", "Placing features"):
            terrain = build(sketch, device=context)
        legend: list[LegendEntry] = []
        with stages.stage("picture", "Drawing the map" if still.top_down else "Rendering"):
            prepare_folder(path.parent)
            if still.top_down:
                write_map(path, terrain, size=still.size)
                return legend
            picture = render_picture(
                terrain,
                size=still.size or (1280, 720),
                camera=camera_from_options(terrain, still.eye, still.look_at),
                view=still.view,
                weather=weather,
                textures=still.textures,
                quality=quality,
                overlays=still.overlays,
                legend=legend,
            )
            write_picture(path, picture)
        return legend

    return run_with_fallback(work, device=device, fast=fast, stages=stages)
