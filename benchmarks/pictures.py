"""Image error against time of rendering qualities, of frames of a flight, and the time of previews."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, replace
from functools import partial
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final
from unittest.mock import patch

import numpy as np
from skimage.color import deltaE_ciede2000, rgb2lab
from skimage.measure import block_reduce

from sketchterrain.benchmarks.plotting import BarPanel, Curves, draw_bars, draw_curves
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import run_program, spread
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import DeviceError
from sketchterrain.generation.building import build
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.offscreen import read_picture
from sketchterrain.render.programs import close_context, open_context
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import find_sun
from sketchterrain.render.views import find_view, tour

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sketchterrain.array_types import Float64Array, UInt8Array
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.generation.terrain import Terrain
    from sketchterrain.render.sky import Sun


BEST: Final = 1.0
RATE: Final = 30.0
"""Frames a second of a moving picture."""
NUDGE: Final = 1e-3
"""m by which the eye moves from frame to frame: nothing new comes into view, but it does not rest."""
SETTLING: Final = (12, 0.5)
"""Frames, and s a frame, after which a moving picture has all that it shows."""

_QUALITIES = {"number": "quality", "still_ms": "whole picture, ms"}
_WITHOUT = {"share": "of the whole, %"}
FLIGHT_RATE: Final = 20.0
"""Frames a second of the automatic flight, as asked of two cores at 1280 × 720."""
_WARM_UP: Final = 60  # frames of up to a second, at most, until the first picture is complete
_CHANGE: Final = 8  # of 255, from which a pixel counts as changed
_STAGES: Final = ("generation", "light", "plant", "draw")
_MOTION = {"within": "tiles within the budget, % of frames"}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Time pictures at several qualities, and compare each with the best.

    The cameras are those that `render --view` chooses. Milliseconds a picture by the clock, until OpenGL has
    finished: of a whole picture whose tiles, light and plants are there, and of a frame in motion, which is a
    smaller picture, enlarged, at low numbers; medians of rounds in which the qualities take turns. From
    nothing: all that has to be made once for the first picture, start of the renderer included. Difference:
    the mean over all pixels of CIEDE2000 to the whole picture of quality 1 of the same size; about 1 is just
    noticeable side by side. Parts: the last view at quality 1 without one part, the same way.

    In motion: frames of the automatic flight at the quality that suits the driver, 1/20 s apart, after a
    complete picture; means of the stages (generation: of tiles) and triangles. At places along it a frame is
    compared with the picture of quality 1 of its camera and clock; plants are the pixels that differ without
    them.

    `generate` with its preview: seconds by the clock of a fresh process, its start included, of the preview
    in it, which other stages share the machine with, and the most memory that it has had; medians of rounds.
    """
    qualities: list[Row] = []
    parts: list[Row] = []
    motion: list[Row] = []
    try:
        gl = open_context()
    except DeviceError as error:
        qualities.append({"opengl": "absent", "note": str(error)})
        return _outcome(qualities, parts, motion, [], effort)
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
        for preset in effort.view_presets:
            terrain = build(load_sketch(preset), device=context)
            motion += [_motion_row(gl, terrain, preset, size, effort) for size in effort.view_sizes]
    finally:
        close_context(gl)
    device = ["--device", str(context.device.index), *(["--fast"] if context.fast else [])]
    previews = [_preview_row(preset, effort, device) for preset in effort.view_presets]
    return _outcome(qualities, parts, motion, previews, effort)


def _outcome(
    qualities: list[Row], parts: list[Row], motion: list[Row], previews: list[Row], effort: Effort
) -> Tables:
    size = "{} × {}".format(*effort.picture_size)
    return (
        Table(f"Pictures by quality, {size}", tuple(qualities), _QUALITIES),
        Table(f"Parts of a picture of quality 1, {size}", tuple(parts), _WITHOUT),
        Table("In motion", tuple(motion), _MOTION),
        Table(f"`generate`, {effort.batch_size} vertices along a side", tuple(previews)),
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


def block_differences(a: UInt8Array, b: UInt8Array) -> Float64Array:
    """Return CIEDE2000 between the mean colours of blocks of 16² pixels of two pictures, (rows, columns)."""
    means = (rgb2lab(block_reduce(each / 255.0, (16, 16, 1), np.mean)) for each in (a, b))
    return np.asarray(deltaE_ciede2000(*means), np.float64)


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
        found[name] = _Found(prepare, [], [], read_picture(texture), None, renderer.scenery.triangles)
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


def _motion_row(gl: Any, terrain: Terrain, preset: str, size: tuple[int, int], effort: Effort) -> Row:
    """Draw the automatic flight, and compare some of its frames with stills."""
    times = np.arange(effort.view_frames + 1) / FLIGHT_RATE  # the first frame is not timed
    cameras = tour(terrain, seconds=float(times[-1])).at(times).cameras
    places = np.linspace(1, effort.view_frames, effort.view_places, dtype=int).tolist()
    sun, quality = find_sun(terrain, cameras[0]), Quality.for_renderer(str(gl.info["GL_RENDERER"]))
    framebuffer = gl.framebuffer([gl.texture(size, 4)])
    renderer = Renderer(gl, terrain, sun=sun, quality=quality)
    any(renderer.frame(cameras[0], framebuffer, elapsed=1.0, budget=1.0).converged for _ in range(_WARM_UP))
    seconds, frames, moving, still = [], [], [], []
    for number, (camera, clock) in enumerate(zip(cameras, times.tolist(), strict=True)):
        start = perf_counter()
        frames.append(renderer.frame(camera, framebuffer, elapsed=1.0 / FLIGHT_RATE, clock=clock))
        gl.finish()
        seconds.append(perf_counter() - start)
        if number in places:
            again = partial(renderer.frame, camera, framebuffer, elapsed=0.0, clock=clock, budget=0.0)
            moving.append(_plants_of(renderer, framebuffer, again))
    renderer.release()
    renderer = Renderer(gl, terrain, sun=sun, quality=Quality.from_level(BEST))
    for number in places:
        renderer.prepare(cameras[number], size)
        draw = partial(renderer.draw, cameras[number], framebuffer, clock=float(times[number]))
        draw()
        still.append(_plants_of(renderer, framebuffer, draw))
    renderer.release()
    differences = [difference(a, b) for (a, _), (b, _) in zip(moving, still, strict=True)]
    stats = {
        key: np.array([getattr(each, key) for each in frames[1:]], np.float64)
        for key in ("triangles", *(f"{stage}_seconds" for stage in _STAGES))
    }
    return {
        "preset": preset,
        "size": "{} × {}".format(*size),
        "fps": 1.0 / statistics.mean(seconds[1:]),
        **spread(seconds[1:]).cells("frames"),
        **{f"{stage}_ms": 1e3 * float(stats[f"{stage}_seconds"].mean()) for stage in _STAGES},
        "within": 100.0 * float(np.mean(stats["generation_seconds"] <= quality.budget)),
        "triangles": round(stats["triangles"].mean()),
        "difference": statistics.mean(differences),
        "plants_moving": sum(plants for _, plants in moving),
        "plants_still": sum(plants for _, plants in still),
        "frame_seconds": seconds[1:],
        "differences": differences,
    }


def _plants_of(renderer: Renderer, framebuffer: Any, draw: Callable[[], object]) -> tuple[UInt8Array, int]:
    """Return the last picture, and how many of its pixels change if it is drawn without plants."""
    picture = read_picture(framebuffer.color_attachments[0])
    with patch.object(renderer.scenery.forest, "draw", lambda *_, **__: iter(())):
        draw()
    without = read_picture(framebuffer.color_attachments[0])
    return picture, int(np.count_nonzero(np.abs(picture.astype(np.int16) - without).max(axis=-1) > _CHANGE))


def _preview_row(preset: str, effort: Effort, device: Sequence[str]) -> Row:
    """Run `generate` in fresh processes."""
    words = ["generate", preset, "--size", str(effort.batch_size), "--json", *device]
    seconds, reports = [], []
    for _ in range(effort.batch_rounds):
        with TemporaryDirectory() as folder:
            start = perf_counter()
            reports.append(run_program([*words, "-o", folder]))
            seconds.append(perf_counter() - start)
    return {
        "preset": preset,
        "seconds": statistics.median(seconds),
        "preview_s": statistics.median(report["timings"]["preview"] for report in reports),
        "megabytes": max(report["peak_memory"] for report in reports) * 1e-6,
        "seconds_each": seconds,
    }


_MOTION_PANELS = (
    BarPanel("Rate", "frames a second", {"mean": "fps"}, asked=(FLIGHT_RATE, 25.0)),
    BarPanel("Stages of a frame", "ms, mean", {stage: f"{stage}_ms" for stage in _STAGES}),
    BarPanel("Difference from stills", "ΔE 2000", {"mean": "difference"}, asked=(5.0,)),
)
_PREVIEW_PANELS = (
    BarPanel("Time", "s", {"whole": "seconds", "preview": "preview_s"}, asked=(10.0,)),
    BarPanel("Memory", "MB", {"most": "megabytes"}, asked=(1200.0,)),
)
_PART_PANELS = (
    BarPanel("Time that it takes", "ms", {"spared": "spared_ms"}),
    BarPanel("What it changes", "ΔE 2000", {"mean": "difference"}),
)
draw_parts = partial(draw_bars, "Parts of a picture of quality 1", _PART_PANELS, ("part",))
draw_motion = partial(draw_bars, "In motion over the automatic flight", _MOTION_PANELS, ("preset", "size"))
draw_previews = partial(draw_bars, "generate with its preview", _PREVIEW_PANELS, ("preset",))


_QUALITY_PANELS = [
    Curves(
        *(title, x, {"": y}),
        by="view",
        text="" if x == "number" else "number",
        units=units,
        scales=scales,
    )
    for kind, title in (("still", "whole picture"), ("moving", "frame in motion"))
    for x, y, units, scales in (
        ("number", f"{kind}_ms", ("quality", "ms"), ("linear", "log")),
        (f"{kind}_ms", f"{kind}_difference", ("ms", "ΔE 2000 to the best"), ("log", "linear")),
    )
]
draw_qualities = partial(draw_curves, "Pictures by quality", _QUALITY_PANELS)
