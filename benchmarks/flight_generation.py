"""Generation in flight in the thesis's terms (section 7.1), by size of tiles and the metric's setting."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Int64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.flight_meshes import height_range
from sketchterrain.benchmarks.flight_scene import (
    PICTURE,
    RATE,
    OwnFrame,
    OwnTiles,
    Stop,
    stops,
    view_of,
    within_world,
)
from sketchterrain.benchmarks.flight_ways import OURS, THESIS, thesis_seconds, thesis_view
from sketchterrain.benchmarks.report import Column, Row, Table
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.tiles.lod import inside_frustum
from sketchterrain.tiles.quadtree import tile_indices

BUDGET: Final = 8e-3
"""s that this program may generate in a frame."""
_SPEED_UP = 10.0
"""How many times as quick as the thesis's way the first complete view is to be."""

_COLUMNS = (
    Column("way", "way"),
    Column("quads", "quads"),
    Column("shown", "setting"),
    Column("initial_ms", "initial generation, ms"),
    Column("updating_ms", "ms a frame while updating"),
    Column("worst_ms", "worst frame, ms"),
    Column("all_ms", "ms over all frames"),
    Column("updating", "frames that update, %"),
    Column("within_budget", "of them within the budget, %"),
    Column("worst_budgets", "worst, budgets"),
    Column("choice_ms", "ms to choose tiles"),
    Column("triangles", "triangles in view"),
)
_FIRST = (
    Column("way", "way"),
    Column("quads", "quads"),
    Column("shown", "setting"),
    Column("tiles", "tiles"),
    Column("ms", "first complete view, ms"),
    Column("kernels_ms", "kernels alone, ms"),
    Column("times", "the thesis's best takes so many times as long"),
    Column("by_kernels", "by kernels"),
    Column("asked", "asked"),
)


class _First(NamedTuple):
    """Tiles of a first view and the seconds until they were there, by the clock and of kernels alone."""

    quads: int
    tiles: int
    seconds: float
    kernels: float


@dataclass
class _Flown:
    """What a flight took: seconds of generation and of the choice of tiles, and triangles, of each frame."""

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
            rows.append(_row(THESIS, quads, setting, f"T = {setting:g}", flown, budget=None))
        for setting in effort.flight_own_pixels:
            flown = _own_flight(terrain, path, quads, setting)
            rows.append(_row(OURS, quads, setting, f"τ = {setting:g} px", flown, budget=BUDGET))
    return Table(f"Generation over {len(path)} frames at 30 Hz, 40 m/s", _COLUMNS, tuple(rows))


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

    ways = (
        (f"{THESIS} all around", thesis),
        (f"{OURS}, what is in view", partial(own, around=False)),
        (f"{OURS}, all around", partial(own, around=True)),
    )
    for quads in effort.flight_quads:
        thesis(quads)  # warms up
        own(quads, around=False, pixels=4 * allowed)
        for name, measure in ways:
            found.setdefault(name, []).append(measure(quads))
    theirs = min(each.seconds for each in found[ways[0][0]])
    kernels = min(each.kernels for each in found[ways[0][0]])
    rows: list[Row] = [
        {
            "way": name,
            "quads": each.quads,
            "shown": f"T = {factor:.3g}" if name == ways[0][0] else f"τ = {allowed:.3g} px",
            "tiles": each.tiles,
            "ms": each.seconds * 1e3,
            "kernels_ms": each.kernels * 1e3,
            "times": None if name == ways[0][0] else theirs / each.seconds,
            "by_kernels": None if name == ways[0][0] else kernels / each.kernels,
            "asked": _SPEED_UP if name == ways[1][0] else None,
        }
        for name, several in found.items()
        for each in several
    ]
    return Table("The first complete view, from nothing", _FIRST, tuple(rows))


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
    """Fly as the thesis does: all tiles of the world are chosen anew, those that were not there generated."""
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


def _row(way: str, quads: int, setting: float, shown: str, flown: _Flown, *, budget: float | None) -> Row:
    seconds = np.array(flown.generation)
    updating = seconds[seconds > 0]
    some = updating if updating.size else np.zeros(1)
    return {
        "way": way,
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
