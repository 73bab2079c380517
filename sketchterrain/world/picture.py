"""One picture of a stored world."""

from __future__ import annotations

from pathlib import Path

from sketchterrain.compute import ComputeContext
from sketchterrain.export.files import prepare_folder
from sketchterrain.export.images import write_picture
from sketchterrain.jobs import run_with_fallback
from sketchterrain.picture_arguments import camera_from_options
from sketchterrain.progress import Stages
from sketchterrain.render import Quality, check_overlays, check_view, render_picture
from sketchterrain.render.overlays import LegendEntry
from sketchterrain.still import PictureOptions, sketch_weather
from sketchterrain.terrain import build
from sketchterrain.world.opening import open_world
from sketchterrain.world.viewed import StoredTerrain


def draw_world(
    store: Path, path: Path, still: PictureOptions, *, device: str | None, stages: Stages
) -> tuple[list[LegendEntry], list[str]]:
    """Draw a stored world and write the picture; return what colours mean, and what the world lacks.

    Places of `still` are metres from the sketch's south-west corner. Raise InputError if there is no such
    world, overlay or view, or something that is looked at is broken; else as `run_with_fallback` does.
    """
    check_overlays(still.overlays)
    check_view(still.view)
    quality = Quality.from_level(still.quality, without=still.without)
    with stages.stage("world", "Opening the world"):
        stored = open_world(store)
        sketch = stored.sketch()

    def work(context: ComputeContext, _: tuple[str, ...]) -> tuple[list[LegendEntry], list[str]]:
        with stages.stage("features", "Placing features"):
            terrain = None if sketch is None else build(sketch, device=context)
            world = StoredTerrain(stored, context, terrain)
        legend: list[LegendEntry] = []
        with stages.stage("picture", "Rendering"):
            prepare_folder(path.parent)
            (x, y), places = world.corner, (still.eye, still.look_at)
            eye, look_at = (place and (place[0] - x, place[1] - y, place[2]) for place in places)
            picture = render_picture(
                world,
                size=still.size or (1280, 720),
                camera=camera_from_options(world, eye, look_at),
                view=still.view,
                weather=sketch_weather(world.sketch, still.hour, still.clouds),
                textures=still.textures,
                quality=quality,
                overlays=still.overlays,
                legend=legend,
            )
            write_picture(path, picture)
        return legend, world.lacks

    return run_with_fallback(work, device=device, stages=stages)
