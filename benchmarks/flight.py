"""A flight over terrain: screen-space error against triangles, generation time and frame time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Int64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.flight_methods import OURS, THESIS, methods, thesis_seconds, thesis_view
from sketchterrain.benchmarks.flight_scene import (
    PICTURE,
    RATE,
    OwnFrame,
    OwnTiles,
    Stop,
    View,
    height_range,
    measured,
    open_world,
    stops,
    view_of,
    within_world,
)
from sketchterrain.benchmarks.report import Row, Table, Tables, value_of
from sketchterrain.benchmarks.screen_error import ErrorSummary
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.generation.terrain import Terrain
from sketchterrain.tiles.lod import inside_frustum
from sketchterrain.tiles.quadtree import tile_indices

BUDGET: Final = 8e-3
"""s that this program may generate in a frame."""
_SPEED_UP = 10.0
"""How many times as quick as the thesis's way the first complete view is to be."""

_GENERATION_HEADINGS = {
    "all_ms": "ms over all frames",
    "updating": "frames that update, %",
    "within_budget": "of them within the budget, %",
}
_FIRST = {"times": "the thesis's best takes so many times as long"}


class _First(NamedTuple):
    """Tiles of a first view and the seconds until they were there, by the clock and of kernels alone."""

    quads: int
    tiles: int
    seconds: float
    kernels: float


@dataclass
class _Flown:
    """Seconds of generation and of the choice of tiles, and triangles, of each frame of a flight."""

    initial: float
    generation: list[float]
    choice: list[float]
    triangles: list[int]


def flights(terrain: Terrain, effort: Effort) -> Table:
    """Fly with every size of tiles and every setting."""
    path = stops(terrain, effort.flight_frames, seconds=effort.flight_frames / RATE)
    rows: list[Row] = []
    for quads in effort.flight_quads:
        for setting in effort.flight_factors:
            flown = _thesis_flight(terrain, path, quads, setting)
            rows.append(_generation_row(THESIS, quads, setting, f"T = {setting:g}", flown, budget=None))
        for setting in effort.flight_own_pixels:
            flown = _own_flight(terrain, path, quads, setting)
            rows.append(_generation_row(OURS, quads, setting, f"τ = {setting:g} px", flown, budget=BUDGET))
    return Table(
        f"Generation over {len(path)} frames at 30 Hz, 40 m/s",
        tuple(rows),
        _GENERATION_HEADINGS,
        hidden=("setting", "samples"),
    )


def first_views(
    context: TimedContext,
    terrain: Terrain,
    effort: Effort,
    *,
    tessellation: float | None,
    tolerance: float | None,
) -> Table:
    """Measure the time from nothing to the first complete view of the world."""
    stop = stops(terrain, 1)[0]
    factor = max(effort.flight_factors) if tessellation is None else tessellation
    allowed = min(effort.flight_own_pixels) if tolerance is None else tolerance
    found: dict[str, list[_First]] = {}

    def thesis(quads: int) -> _First:
        chosen = _places(terrain, stop, quads, factor)
        seconds: list[float] = []
        lap = context.lap(lambda: seconds.append(thesis_seconds(terrain, chosen[:, :3], quads)))
        return _First(quads, len(chosen), seconds[0], lap.device)

    def own(quads: int, *, around: bool, pixels: float = allowed) -> _First:
        tiles = OwnTiles(terrain, quads=quads, tolerance=pixels)
        frames: list[OwnFrame] = []
        view = view_of(stop, terrain.extent, around=around)
        lap = context.lap(lambda: frames.append(tiles.converge(view)))
        return _First(quads, frames[0].tiles, frames[0].generation + frames[0].choice, lap.device)

    methods = (
        (f"{THESIS} all around", thesis),
        (f"{OURS}, what is in view", partial(own, around=False)),
        (f"{OURS}, all around", partial(own, around=True)),
    )
    for quads in effort.flight_quads:
        thesis(quads)  # warms up
        own(quads, around=False, pixels=4 * allowed)
        for name, measure in methods:
            found.setdefault(name, []).append(measure(quads))
    theirs = min(each.seconds for each in found[methods[0][0]])
    kernels = min(each.kernels for each in found[methods[0][0]])
    rows: list[Row] = [
        {
            "way": name,
            "quads": each.quads,
            "shown": f"T = {factor:.3g}" if name == methods[0][0] else f"τ = {allowed:.3g} px",
            "tiles": each.tiles,
            "ms": each.seconds * 1e3,
            "kernels_ms": each.kernels * 1e3,
            "times": None if name == methods[0][0] else theirs / each.seconds,
            "by_kernels": None if name == methods[0][0] else kernels / each.kernels,
            "asked": _SPEED_UP if name == methods[1][0] else None,
        }
        for name, several in found.items()
        for each in several
    ]
    return Table("The first complete view, from nothing", tuple(rows), _FIRST)


def _own_flight(terrain: Terrain, path: Sequence[Stop], quads: int, tolerance: float) -> _Flown:
    tiles = OwnTiles(terrain, quads=quads, tolerance=tolerance)
    first = tiles.converge(view_of(path[0], terrain.extent))
    flown = _Flown(first.generation + first.choice, [], [], [])
    for stop in path:
        frame = tiles.frame(view_of(stop, terrain.extent), elapsed=1.0 / RATE, budget=BUDGET)
        flown.generation.append(frame.generation)
        flown.choice.append(frame.choice)
        flown.triangles.append(within_world(frame.draws, quads).triangles)
    return flown


def _thesis_flight(terrain: Terrain, path: Sequence[Stop], quads: int, tessellation: float) -> _Flown:
    """Fly as the thesis does: all tiles are selected again in each frame, the new ones generated."""
    flown = _Flown(0.0, [], [], [])
    known: set[tuple[int, ...]] = set()
    for number, stop in enumerate(path):
        start = perf_counter()
        chosen = _places(terrain, stop, quads, tessellation)
        choice = perf_counter() - start
        keys = {(a, b, c) for a, b, c, _ in chosen.tolist()}
        fresh = np.array(sorted(keys - known), np.int64).reshape(-1, 3)
        known = set(keys)
        seconds = thesis_seconds(terrain, fresh, quads)
        if number == 0:
            flown.initial, seconds = seconds, 0.0
        flown.generation.append(seconds)
        flown.choice.append(choice)
        flown.triangles.append(_triangles_in_view(terrain, stop, chosen, quads))
    return flown


def _triangles_in_view(terrain: Terrain, stop: Stop, chosen: Int64Array, quads: int) -> int:
    """Count the triangles of tiles in the frustum, as far as the world's lowest and highest ground tells."""
    width = terrain.extent * np.exp2(-chosen[:, :1].astype(np.float64))
    corner = chosen[:, 1:3] * width
    bottom, top = (np.full_like(width, each) for each in height_range(terrain))
    seen = inside_frustum(
        stop.camera.frustum(PICTURE.width / PICTURE.height),
        np.hstack([corner, bottom]),
        np.hstack([corner + width, top]),
    )
    _, _, count = tile_indices(quads)
    return int(count[chosen[seen, 3]].sum()) // 3


def _places(terrain: Terrain, stop: Stop, quads: int, tessellation: float) -> Int64Array:
    tiles = thesis_view(terrain, quads, tessellation).tiles(stop.camera.eye, stop.ground)
    return np.array(tiles, np.int64)


def _generation_row(
    method: str, quads: int, setting: float, shown: str, flown: _Flown, *, budget: float | None
) -> Row:
    seconds = np.array(flown.generation)
    updating = seconds[seconds > 0]
    some = updating if updating.size else np.zeros(1)
    return {
        "way": method,
        "quads": quads,
        "setting": setting,
        "shown": shown,
        "initial_ms": flown.initial * 1e3,
        "updating_ms": float(some.mean()) * 1e3,
        "worst_ms": float(some.max()) * 1e3,
        "all_ms": float(seconds.mean()) * 1e3,
        "updating": 100.0 * updating.size / seconds.size,
        "within_budget": None if budget is None else 100.0 * float(np.mean(some <= budget)),
        "worst_budgets": None if budget is None else float(some.max()) / budget,
        "choice_ms": float(np.mean(flown.choice)) * 1e3,
        "triangles": round(float(np.mean(flown.triangles))),
        "seconds": flown.generation,
        "choice_seconds": flown.choice,
        "triangles_each": flown.triangles,
    }


MOST = "most_px"
"""The key of the measured error that ways are compared at: what 99.9 % of the samples stay within, px."""

_HALF = 0.5
"""The share of the thesis's triangles that this program may draw at the same error."""

_ERROR_HEADINGS = {"within": "samples within 1 px, %", MOST: "99.9 % within, px"}
_REACHING = {"of_thesis": "of the thesis's metric's best"}


def points(terrain: Terrain, effort: Effort) -> Table:
    """Measure every way at each of its settings over views of the flight."""
    views = [View(stop, PICTURE) for stop in stops(terrain, effort.flight_views)]
    found, absent = methods(terrain, effort)
    rows: list[Row] = []
    for method in found:
        method.draw(views[0], method.settings[0])  # warms up
        for setting in method.settings:
            triangles, seconds, distances, whole = [], [], [], True
            for view in views:
                shown = method.draw(view, setting)
                triangles.append(shown.triangles)
                seconds.append(shown.seconds)
                whole &= shown.whole
                distances.append(measured(terrain, shown.meshes, view, every=effort.flight_every))
            error = ErrorSummary.of(np.concatenate(distances))
            rows.append(
                {
                    "way": method.name,
                    "setting": setting,
                    "shown": method.unit.format(setting),
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
    return Table(
        f"Screen error at {len(views)} places of the flight",
        tuple(rows),
        _ERROR_HEADINGS,
        hidden=("setting", "samples"),
    )


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
    return Table(
        "Triangles where 99.9 % of the samples are within 1 px",
        tuple(found),
        _REACHING,
        hidden=("setting", "samples"),
    )


def reaching(rows: Sequence[Row], method: str, key: str, *, pixels: float = 1.0) -> float | None:
    """Return a way's value at an error, on straight lines between its points in logarithms.

    None where its points don't lie to both sides of the error.
    """
    known = sorted(
        (value_of(row, MOST), value_of(row, key))
        for row in rows
        if row["way"] == method and value_of(row, MOST) > 0
    )
    errors = np.log([error for error, _ in known])
    if not known or not errors[0] <= np.log(pixels) <= errors[-1]:
        return None
    return float(np.exp(np.interp(np.log(pixels), errors, np.log([value for _, value in known]))))


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Compare level-of-detail methods for views of a world, by screen error, triangles and time.

    The world is valley_river scaled to 4096 m, the finest quads are at least 0.2 m; the camera flies 10 s at
    40 m/s along a circle, 4 to 120 m above the ground, with pictures of 1280 × 720 pixels and 45° high.

    Screen error: rays through every fourth pixel both ways find the displayed triangles; the error is the
    distance in pixels to the terrain in full detail at the same x, y. Methods are compared at the error that
    99.9 % of the samples stay within. Triangles are those of tiles in view, borders to coarser tiles
    included; times are by the clock from nothing to the last tile in view, medians of views; for this
    program include the choice of tiles, coarser ones on the way, and all that its vertices carry.

    The thesis's metric (Zaaijer 2013, chapter 2): no quad longer than √d / (T · F), F = 2 near mountains and
    rivers and 1 elsewhere (the thesis gives no values), tiles across an edge one level apart, same terrain;
    its time is that of its own kernels, one launch of each a tile. Uniform grid: one level of the tiles in
    view. pymartini and pydelatin: heightmaps of 257² samples at most two pixels apart, simplified to the
    height of so many pixels at the nearest point; time covers computing and simplifying them.

    Flights: in each frame this program generates what fits into 8 ms and morphs; the thesis's method
    generates at once all new tiles that its metric requires all around. Milliseconds of generation by the
    clock. The first complete view: the time from nothing until all tiles are present, with the T and the τ of
    an error of one pixel; kernels alone by profiling events.
    """
    terrain = open_world(context)
    errors = points(terrain, effort)
    generation = flights(terrain, effort)
    thesis, own = (_at_one_pixel_setting(errors, method) for method in (THESIS, OURS))
    first = first_views(context, terrain, effort, tessellation=thesis, tolerance=own)
    return (errors, generation, at_one_pixel(errors.rows), first)


def _at_one_pixel_setting(errors: Table, start: str) -> float | None:
    """Return what a way with its largest tiles is set to where it errs by one pixel, if known."""
    methods = [str(row["way"]) for row in errors.rows if str(row["way"]).startswith(start)]
    return reaching(errors.rows, methods[-1], "setting")
