"""One still of a sketch's terrain: a picture, or a map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sketchterrain.export import prepare_folder, write_map, write_picture
from sketchterrain.jobs import run_with_fallback
from sketchterrain.picture_arguments import camera_from_options
from sketchterrain.render import Quality, Weather, check_overlays, check_view, render_picture
from sketchterrain.render.sunlight import sun_at
from sketchterrain.terrain import build

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.compute import ComputeContext
    from sketchterrain.picture_arguments import Point
    from sketchterrain.progress import Stages
    from sketchterrain.render import scene
    from sketchterrain.render.overlays import LegendEntry
    from sketchterrain.sketch import Sketch


@dataclass(frozen=True)
class PictureOptions:
    """How a picture is taken.

    Attributes
    ----------
    size : (int, int) or None
        Width and height, pixels.
    eye, look_at : Point or None
        Of the camera (m).
    view : str
        What kind of view is chosen where there is no eye.
    hour, clouds : float or None
        In place of the sketch's.
    quality : float
        0 … 1.
    without, overlays : tuple of str
        Parts that are left out; names of what is drawn over the picture.
    textures : Path or None
        A folder of the user's own.
    top_down : bool
        A map instead of all that; only the size counts.
    """

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
    """Return a sketch's weather, with an hour and clouds in place of its own if they are given.

    Raises
    ------
    InputError
        If the sun stands too low at that hour.
    """
    weather = Weather.of(sketch, hour=hour, clouds=clouds)
    if weather.hour is not None:
        sun_at(weather.hour, weather.latitude)  # now, not when all else is done
    return weather


def render_to_file(
    sketch: Sketch, path: Path, still: PictureOptions, *, device: str | None, fast: bool, stages: Stages
) -> list[LegendEntry]:
    """Draw a sketch's terrain and write it.

    Parameters
    ----------
    sketch
        With the seed that counts.
    path
        ``.png``, or for a map ``.svg`` too.
    still
        How.
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`.
    fast
        Whether the kernels may trade bits for speed.
    stages
        Told and timed: ``device``, ``features`` and ``picture``.

    Returns
    -------
    list of LegendEntry
        What the overlays' colours mean.

    Raises
    ------
    InputError
        If there is no such overlay, view or part, or the sun stands too low.
    DeviceError
        If there is no such device, none that did not fail, or no OpenGL.
    SketchterrainError
        If the file cannot be written.
    """
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
