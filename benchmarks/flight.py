"""A flight over terrain: screen-space error against triangles, generation and frame times."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.flight_generation import first_views, flights
from sketchterrain.benchmarks.flight_meshes import View, measured
from sketchterrain.benchmarks.flight_scene import PICTURE, RATE, open_world, stops
from sketchterrain.benchmarks.flight_ways import OURS, THESIS, ways
from sketchterrain.benchmarks.report import Column, Outcome, Row, Table, value_of
from sketchterrain.benchmarks.screen_error import ErrorSummary
from sketchterrain.errors import DeviceError
from sketchterrain.render.programs import close_context, open_context
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import find_sun

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext
    from sketchterrain.render.budgets import FrameStats
    from sketchterrain.terrain.terrain import Terrain


MOST = "most_px"
"""The key of the measured error that ways are compared at: what 99.9 % of the samples stay within, px."""

_HALF = 0.5
"""The share of the thesis's triangles that this program may draw at the same error."""

_COLUMNS = (
    Column("way", "way"),
    Column("shown", "setting"),
    Column("triangles", "triangles in view"),
    Column("ms", "ms from nothing"),
    Column("within", "samples within 1 px, %"),
    Column(MOST, "99.9 % within, px"),
    Column("worst_px", "worst, px"),
    Column("note", "note"),
)
_REACHING = (
    Column("way", "way"),
    Column("triangles", "triangles at 1 px"),
    Column("of_thesis", "of the thesis's metric's best"),
    Column("asked", "asked: at most"),
    Column("ms", "ms from nothing"),
)


def points(terrain: Terrain, effort: Effort) -> Table:
    """Measure every way at each of its settings over views of the flight."""
    views = [View(stop, PICTURE) for stop in stops(terrain, effort.flight_views)]
    found, absent = ways(terrain, effort)
    rows: list[Row] = []
    for way in found:
        way.draw(views[0], way.settings[0])  # warms up
        for setting in way.settings:
            triangles, seconds, distances, whole = [], [], [], True
            for view in views:
                shown = way.draw(view, setting)
                triangles.append(shown.triangles)
                seconds.append(shown.seconds)
                whole &= shown.whole
                distances.append(measured(terrain, shown.meshes, view, every=effort.flight_every))
            error = ErrorSummary.of(np.concatenate(distances))
            rows.append(
                {
                    "way": way.name,
                    "setting": setting,
                    "shown": way.unit.format(setting),
                    "triangles": round(float(np.mean(triangles))),
                    "ms": float(np.median(seconds)) * 1e3,
                    "within": error.within * 100,
                    MOST: error.most,
                    "worst_px": error.worst,
                    "samples": error.samples,
                    "note": None if whole else "pool too small",
                    "triangles_each": triangles,
                    "seconds_each": seconds,
                }
            )
    rows += [{"way": one.name, "note": f"absent: {one.reason}"} for one in absent]
    return Table(f"Screen error at {len(views)} places of the flight", _COLUMNS, tuple(rows))


def at_one_pixel(rows: Sequence[Row]) -> Table:
    """Return where each way reaches one pixel of measured error, from its points."""
    names = list(dict.fromkeys(str(row["way"]) for row in rows if row.get(MOST) is not None))
    triangles = {name: reaching(rows, name, "triangles") for name in names}
    theirs = [each for name, each in triangles.items() if name.startswith(THESIS) and each is not None]
    thesis = min(theirs, default=None)
    found: list[Row] = []
    for name in names:
        here = triangles[name]
        found.append(
            {
                "way": name,
                "triangles": None if here is None else round(here),
                "of_thesis": None if here is None or thesis is None else here / thesis,
                "asked": _HALF if name.startswith(OURS) else None,
                "ms": reaching(rows, name, "ms"),
                "setting": reaching(rows, name, "setting"),
            }
        )
    return Table("Triangles where 99.9 % of the samples are within 1 px", _REACHING, tuple(found))


def reaching(rows: Sequence[Row], way: str, key: str, *, pixels: float = 1.0) -> float | None:
    """Return a way's value at an error, on straight lines between its points in logarithms.

    None where its points don't lie to both sides of the error.
    """
    known = sorted(
        (value_of(row, MOST), value_of(row, key))
        for row in rows
        if row["way"] == way and value_of(row, MOST) > 0
    )
    errors = np.log([error for error, _ in known])
    if not known or not errors[0] <= np.log(pixels) <= errors[-1]:
        return None
    return float(np.exp(np.interp(np.log(pixels), errors, np.log([value for _, value in known]))))


SHARE_WITHIN = 99.0
"""% of the frames with new tiles that are to make them within the budget; all within twice it."""

_FLIGHT_FRAMES_COLUMNS = (
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
        return Table(title, _FLIGHT_FRAMES_COLUMNS, ({"opengl": "absent", "note": str(error)},))
    return Table(title, _FLIGHT_FRAMES_COLUMNS, (_row(found),))


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


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Compare ways to choose triangles for views of a world, by screen error, triangles and time.

    The world is valley_river laid over 4096 m, the finest quads are not under 0.2 m; the camera flies 10 s at
    40 m/s along a circle, 4 to 120 m above the ground, and takes pictures of 1280 × 720 pixels, 45° high.

    Screen error: at places of the flight, rays through every fourth pixel both ways find the drawn triangles;
    the distance in pixels from what is seen to the terrain in full detail at the same x, y is the error. Full
    detail is more than 16 times the resolution of whatever is drawn, and the same for all. Ways are compared
    at the error that 99.9 % of the samples stay within. Triangles are those of tiles in view, borders to
    coarser tiles included; times are by the clock from nothing to the last tile in view, medians of views.
    The program's time covers the choice of tiles, coarser ones on the way, and all that its vertices carry.

    The thesis's metric (Zaaijer 2013, chapter 2): no quad longer than √d / (T · F), F = 2 near mountains and
    rivers and 1 elsewhere (the thesis tells no values), tiles across an edge one level apart. Its triangles
    stand on this terrain, its time is that of its own kernels, a launch of each a tile, without the choice
    and without what is prepared on the host. Uniform grid: one level, tiles out of view left out. pymartini
    and pydelatin: heightmaps of 257² samples two pixels apart at most, each thinned out to the height that so
    many pixels are at its nearest point; gaps between maps are left; time covers making and thinning them.

    Flights: each frame, this program generates what fits into 8 ms and morphs; the thesis's way generates at
    once what its metric asks for all around and was not there in the frame before. Milliseconds of generation
    by the clock: at the start, the mean of frames that generate, the worst, the mean of all. The first
    complete view: the time from nothing until all tiles are there, both with the T and the τ where they err
    by one pixel; kernels alone by profiling events.

    Frames as drawn: the renderer itself, at the quality that suits the driver, from a complete first picture
    on; the clock stops when OpenGL has finished.
    """
    terrain = open_world(context)
    errors = points(terrain, effort)
    generation = flights(terrain, effort)
    thesis, own = (_at_one_pixel_setting(errors, way) for way in (THESIS, OURS))
    drawn = frames(terrain, effort)
    first = first_views(context, terrain, effort, tessellation=thesis, tolerance=own)
    return Outcome((errors, generation, drawn, at_one_pixel(errors.rows), first))


def _at_one_pixel_setting(errors: Table, start: str) -> float | None:
    """Return what a way with its largest tiles is set to where it errs by one pixel, if known."""
    ways = [str(row["way"]) for row in errors.rows if str(row["way"]).startswith(start)]
    return reaching(errors.rows, ways[-1], "setting")
