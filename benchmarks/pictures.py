"""Image error against time of rendering qualities."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from skimage.color import deltaE_ciede2000, rgb2lab

from sketchterrain.benchmarks.plotting import HUES, SMALL, new_figure
from sketchterrain.benchmarks.report import Column, Outcome, Row, Table, value_of
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import DeviceError
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.programs import close_context, open_context
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import find_sun
from sketchterrain.render.views import find_view
from sketchterrain.terrain.building import build

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sketchterrain.array_types import UInt8Array
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.sky import Sun
    from sketchterrain.terrain.terrain import Terrain


BEST: Final = 1.0
RATE: Final = 30.0
"""Frames a second of a moving picture."""
NUDGE: Final = 1e-3
"""m by which the eye moves from frame to frame: nothing new comes into view, but it does not rest."""
SETTLING: Final = (12, 0.5)
"""Frames, and s a frame, after which a moving picture has all that it shows."""

_QUALITIES = (
    Column("opengl", "OpenGL"),
    Column("view", "view"),
    Column("number", "quality"),
    Column("still_ms", "whole picture, ms"),
    Column("still_difference", "its difference, ΔE"),
    Column("moving_ms", "frame in motion, ms"),
    Column("moving_difference", "its difference, ΔE"),
    Column("prepare_ms", "from nothing, ms"),
    Column("triangles", "triangles"),
    Column("note", "note"),
)
_WITHOUT = (
    Column("part", "part left out"),
    Column("view", "view"),
    Column("spared_ms", "spared, ms"),
    Column("share", "of the whole, %"),
    Column("difference", "difference, ΔE"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Time pictures at several qualities, and compare each with the best.

    The cameras are those that `render --view` chooses. Milliseconds a picture by the clock, until OpenGL has
    finished: of a whole picture whose tiles, light and plants are there, and of a frame in motion, which is a
    smaller picture, enlarged, at low numbers; medians of rounds in which the qualities take turns. From
    nothing: all that has to be made once for the first picture, start of the renderer included. Difference:
    the mean over all pixels of CIEDE2000 to the whole picture of quality 1 of the same size; about 1 is just
    noticeable side by side. Parts: the last view at quality 1 without one part, the same way.
    """
    qualities: list[Row] = []
    parts: list[Row] = []
    try:
        gl = open_context()
    except DeviceError as error:
        qualities.append({"opengl": "absent", "note": str(error)})
        return _outcome(qualities, parts, effort)
    try:
        for preset, kind in effort.picture_views:
            scene, view = _scene(context, preset, kind), f"{preset}, {kind}"
            numbers = {str(number): Quality.from_level(number) for number in (*effort.picture_numbers, BEST)}
            found = _rounds(gl, scene, numbers, effort, moving=True)
            best = found[str(BEST)]
            qualities += [_quality_row(gl, view, number, each, best) for number, each in found.items()]
        whole = Quality.from_level(BEST)
        lacking = {part: replace(whole, without=frozenset([part])) for part in effort.picture_parts}
        each_part = _rounds(gl, scene, {"": whole, **lacking}, effort, moving=False)
        parts += [_part_row(view, part, each_part) for part in effort.picture_parts]
    finally:
        close_context(gl)
    return _outcome(qualities, parts, effort)


def _outcome(qualities: list[Row], parts: list[Row], effort: Effort) -> Outcome:
    size = "{} × {}".format(*effort.picture_size)
    return Outcome(
        (
            Table(f"Pictures by quality, {size}", _QUALITIES, tuple(qualities)),
            Table(f"Parts of a picture of quality 1, {size}", _WITHOUT, tuple(parts)),
        )
    )


@dataclass(frozen=True)
class _Scene:
    terrain: Terrain
    camera: Camera
    sun: Sun


@dataclass
class _Found:
    """What was measured of one setting (s), and the pictures."""

    prepare: float
    still: list[float]
    moving: list[float]
    picture: UInt8Array
    in_motion: UInt8Array | None
    triangles: int


def difference(a: UInt8Array, b: UInt8Array) -> float:
    """Return the mean of CIEDE2000 over all pixels of two pictures of one size."""
    return float(np.mean(deltaE_ciede2000(rgb2lab(a), rgb2lab(b))))


def _scene(context: ComputeContext, preset: str, kind: str) -> _Scene:
    terrain = build(load_sketch(preset), device=context)
    camera = find_view(terrain, kind)
    return _Scene(terrain, camera, find_sun(terrain, camera))


def _rounds(
    gl: Any, scene: _Scene, settings: Mapping[str, Quality], effort: Effort, *, moving: bool
) -> dict[str, _Found]:
    texture = gl.texture(effort.picture_size, 4)
    framebuffer = gl.framebuffer([texture])
    renderers: dict[str, Renderer] = {}
    found: dict[str, _Found] = {}
    for name, quality in settings.items():
        start = perf_counter()
        renderer = renderers[name] = Renderer(gl, scene.terrain, sun=scene.sun, quality=quality)
        renderer.prepare(scene.camera, effort.picture_size)
        gl.finish()
        prepare = perf_counter() - start
        renderer.draw(scene.camera, framebuffer)
        found[name] = _Found(prepare, [], [], read_picture(texture), None, renderer.triangles)
    for _ in range(effort.picture_rounds):
        for name, renderer in renderers.items():
            start = perf_counter()
            renderer.draw(scene.camera, framebuffer)
            gl.finish()
            found[name].still.append(perf_counter() - start)
    if moving:
        for name, renderer in renderers.items():
            _settle(renderer, scene.camera, framebuffer)
            found[name].in_motion = read_picture(texture)
        for turn in range(effort.picture_rounds):
            for name, renderer in renderers.items():
                start = perf_counter()
                renderer.frame(_nudged(scene.camera, turn), framebuffer, elapsed=1.0 / RATE)
                gl.finish()
                found[name].moving.append(perf_counter() - start)
    return found


def _settle(renderer: Renderer, camera: Camera, framebuffer: Any) -> None:
    """Show frames of an eye that all but rests until what is drawn has become what is wanted."""
    frames, elapsed = SETTLING
    for turn in range(frames):
        renderer.frame(_nudged(camera, turn), framebuffer, elapsed=elapsed)


def _nudged(camera: Camera, turn: int) -> Camera:
    x, y, z = camera.eye
    return replace(camera, eye=(x + NUDGE * (turn % 2), y, z))


def _quality_row(gl: Any, view: str, number: str, found: _Found, best: _Found) -> Row:
    moved = found.picture if found.in_motion is None else found.in_motion
    return {
        "opengl": str(gl.info["GL_RENDERER"]),
        "view": view,
        "number": float(number),
        "still_ms": 1e3 * statistics.median(found.still),
        "still_difference": difference(found.picture, best.picture),
        "moving_ms": 1e3 * statistics.median(found.moving),
        "moving_difference": difference(moved, best.picture),
        "prepare_ms": 1e3 * found.prepare,
        "triangles": found.triangles,
        "note": None,
        "still_seconds": found.still,
        "moving_seconds": found.moving,
    }


def _part_row(view: str, part: str, found: Mapping[str, _Found]) -> Row:
    whole, without = found[""], found[part]
    spared = statistics.median(whole.still) - statistics.median(without.still)
    return {
        "part": part,
        "view": view,
        "spared_ms": 1e3 * spared,
        "share": 100.0 * spared / statistics.median(whole.still),
        "difference": difference(whole.picture, without.picture),
    }


def draw_qualities(rows: Sequence[Row]) -> Any:
    """Draw the time of a picture by its quality, and its difference from the best against that time."""
    figure = new_figure(11.0, 6.4)
    panels = figure.subplots(2, 2)
    known = [row for row in rows if row["opengl"] != "absent"]
    views = list(dict.fromkeys(str(row["view"]) for row in known))
    kinds = (("still", "whole picture"), ("moving", "frame in motion"))
    for (kind, title), (left, right) in zip(kinds, panels, strict=True):
        for view, hue in zip(views, HUES, strict=False):
            of_view = sorted((row for row in known if row["view"] == view), key=_number)
            numbers = [_number(row) for row in of_view]
            times = [value_of(row, f"{kind}_ms") for row in of_view]
            differences = [value_of(row, f"{kind}_difference") for row in of_view]
            left.plot(numbers, times, color=hue, marker="o", markersize=3.5, linewidth=1.3, label=view)
            right.plot(times, differences, color=hue, marker="o", markersize=3.5, linewidth=1.3)
            for number, time, apart in zip(numbers, times, differences, strict=True):
                right.annotate(f" {number:g}", (time, apart), fontsize=SMALL, color=hue)
        left.set(title=f"{title}: time", xlabel="quality", ylabel="ms", yscale="log")
        right.set(title=f"{title}: difference from the best", xlabel="ms", ylabel="ΔE 2000", xscale="log")
        right.set_ylim(bottom=0.0)
        for axis in (left.yaxis, right.xaxis):
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:g}"[0] in "25" else "")
    figure.legend(
        *panels[0][0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=4,
        fontsize=SMALL,
        frameon=False,
    )
    drivers = ", ".join(dict.fromkeys(str(row["opengl"]) for row in known))
    figure.suptitle(f"Pictures by {drivers or 'no OpenGL'}", x=0.01, ha="left")
    return figure


def draw_parts(rows: Sequence[Row]) -> Any:
    """Draw what each part of the best picture takes, and how much of the picture it is."""
    figure = new_figure(11.0, 3.6)
    left, right = figure.subplots(1, 2)
    parts = list(dict.fromkeys(str(row["part"]) for row in rows))
    views = list(dict.fromkeys(str(row["view"]) for row in rows))
    thick = 0.8 / max(len(views), 1)
    for number, (view, hue) in enumerate(zip(views, HUES, strict=False)):
        of_view = {str(row["part"]): row for row in rows if row["view"] == view}
        at = np.arange(len(parts)) + (number - (len(views) - 1) / 2) * thick
        for axes, key in ((left, "spared_ms"), (right, "difference")):
            values = [value_of(of_view[part], key) for part in parts]
            axes.barh(at, values, height=thick, color=hue, label=view)
    for axes, title, unit in ((left, "time that it takes", "ms"), (right, "what it changes", "ΔE 2000")):
        axes.set(title=title, xlabel=unit, yticks=range(len(parts)), yticklabels=parts)
        axes.invert_yaxis()
    left.legend(fontsize=SMALL, frameon=False)
    return figure


def _number(row: Row) -> float:
    return value_of(row, "number")
