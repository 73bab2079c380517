"""`render`: a picture or a topographic map of a sketch's terrain."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sketchterrain.app.arguments import Point, camera_from_options
from sketchterrain.app.jobs import run_with_fallback
from sketchterrain.app.progress import Stages
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.export.files import prepare_folder
from sketchterrain.export.map.sheet import write_map
from sketchterrain.export.rasters import write_picture
from sketchterrain.render import scene
from sketchterrain.render.offscreen import render_picture
from sketchterrain.render.overlays import LegendEntry, check_overlays
from sketchterrain.render.quality import Quality
from sketchterrain.render.sky import Weather, sun_at
from sketchterrain.render.views import check_view
from sketchterrain.terrain.building import build


@dataclass(frozen=True)
class PictureOptions:
    """Camera, light and content of a picture; of a map only the size counts."""

    size: tuple[int, int] | None = None  # width, height (px)
    eye: Point | None = None  # m; without it a view is found
    look_at: Point | None = None
    view: str = "auto"
    hour: float | None = None  # in place of the sketch's, as clouds
    clouds: float | None = None
    quality: float = 1.0
    without: tuple[str, ...] = ()
    overlays: tuple[str, ...] = ()
    textures: Path | None = None
    top_down: bool = False  # a map


def sketch_weather(sketch: scene.Sketch, hour: float | None, clouds: float | None) -> Weather:
    """Return a sketch's weather, with another hour or clouds if given; raise InputError at night."""
    weather = Weather.from_sketch(sketch, hour=hour, clouds=clouds)
    if weather.hour is not None:
        sun_at(weather.hour, weather.latitude)
    return weather


def render_to_file(
    sketch: Sketch, path: Path, options: PictureOptions, *, device: str | None, fast: bool, stages: Stages
) -> list[LegendEntry]:
    """Render a sketch's terrain to a .png, or a map to an .svg too; return the legend of the overlays."""
    check_overlays(options.overlays)
    check_view(options.view)
    quality = Quality.from_level(options.quality, without=options.without)
    weather = sketch_weather(sketch, options.hour, options.clouds)

    def work(context: ComputeContext, _: tuple[str, ...]) -> list[LegendEntry]:
        with stages.stage("features", "Placing features"):
            terrain = build(sketch, device=context)
        legend: list[LegendEntry] = []
        with stages.stage("picture", "Drawing the map" if options.top_down else "Rendering"):
            prepare_folder(path.parent)
            if options.top_down:
                write_map(path, terrain, size=options.size)
                return legend
            picture = render_picture(
                terrain,
                size=options.size or (1280, 720),
                camera=camera_from_options(terrain, options.eye, options.look_at),
                view=options.view,
                weather=weather,
                textures=options.textures,
                quality=quality,
                overlays=options.overlays,
                legend=legend,
            )
            write_picture(path, picture)
        return legend

    return run_with_fallback(work, device=device, fast=fast, stages=stages)
