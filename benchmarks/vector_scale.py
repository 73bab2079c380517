"""Scale of vectors: 10³ to 6·10⁵ curves at one density: loading, memory, tiles, edits, a flight."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Final

import numpy as np

from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.low_flight import SIZE, TileUpdates, flight_table
from sketchterrain.benchmarks.plotting import Curves, draw_curves
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.synthetic_land import EXTENT, SEED, SIDE, curve_count, synthetic_land
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate, lap
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import InputError
from sketchterrain.features.edits import move_node
from sketchterrain.features.table import FeatureTable
from sketchterrain.generation.building import build, make_recipe
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.camera import Camera
from sketchterrain.io.system import peak_memory
from sketchterrain.render.ground_stream import view_of
from sketchterrain.stages.runner import Results

_LEVELS: Final = {7: 4, 9: 8, 12: 8, 15: 8}
"""Levels of tiles, and tiles along the side of a square of them in the middle of every country."""
_PAINTED = 4  # appearance tiles along its side
_STAGES: Final = ("vectors", "recipe", "terrain", "tiles")
_MOVED = 15.0  # m
_FOV = 64.0
_HIGH, _VIEW = 300.0, 2000.0  # m above the ground; of the ground ahead that is edited

_EDITS = {"changed": "tiles an edit", "equal": "tiles like a new terrain's, bit for bit"}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Load, show and edit a country of fields, woods, villages and roads, from 10³ to 6·10⁵ curves.

    The largest has as many curves and areas as Bruneton & Neyret (2008). Each smaller one is the middle of a
    larger one, on the same ground of 100 × 100 km, so that tiles in the middle see the same vectors whatever
    their number is elsewhere. A curve leads from corner to corner.

    Loading: a process of its own reads the sketch from files, builds the terrain, and evaluates 64 tiles of
    ground and 16 of appearance; the memory is its most. Tiles: milliseconds each, of squares of tiles in the
    middle; countries alternate. Edits: a random corner of 2 × 2 km ahead of the camera, 300 m up, is moved by
    up to 15 m; with roads a twentieth as often. `vectors`: the new layer of the sketch; `recipe`: areas and
    networks; `terrain`: differences and indices; `tiles`: those in view, of ground and appearance.

    The flight: 13 km in 73 s, from 2000 km/h at 5000 m to 60 km/h at 8 m and 90 km/h
    at 5 m; tiles are selected and evaluated as the renderer does, within 6 ms a frame for ground and
    10 ms for appearance, but not drawn.
    """
    countries = {side: synthetic_land(side) for side in effort.scale_sides}
    loads = {side: _loaded(sketch) for side, sketch in countries.items()}
    terrains = {side: build(sketch, device=context) for side, sketch in countries.items()}
    scale = tuple(_scale_rows(terrains, loads, effort.rounds))
    flight = flight_table(terrains[max(terrains)], effort.scale_frames)
    few, many = min(countries), max(countries)
    edits = [
        _edit_row(side, _without_roads(countries[side]), "without", context, effort.scale_edits)
        for side in (few, many)
    ]
    edits.append(_edit_row(many, countries[many], "with", context, max(effort.scale_edits // 20, 2)))
    return (
        Table("Countries of one density", scale),
        flight,
        Table("Edits in view", tuple(edits), _EDITS),
    )


def _without_roads(sketch: Sketch) -> Sketch:
    return sketch.replace(vectors={"landuse": sketch.vectors["landuse"]})


def _loaded(sketch: Sketch) -> tuple[float, float, float]:
    """Return the seconds to load a sketch in a process of its own, those of its roads, and MB."""
    with TemporaryDirectory(prefix="sketchterrain-scale-") as folder:
        save_sketch(sketch, Path(folder, "sketch"))
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            return pool.apply(_load, (str(Path(folder, "sketch")),))


def _load(folder: str) -> tuple[float, float, float]:
    context = ComputeContext()
    start = perf_counter()
    sketch = load_sketch(folder)
    memory = Results()
    make_recipe(_without_roads(sketch), memory=memory)
    before = perf_counter()
    terrain = Terrain(sketch, make_recipe(sketch, memory=memory), context, memory=memory)
    roads = perf_counter() - before
    terrain.evaluator.tiles(_middle(9, 8), 9)
    terrain.appearance.tiles([(9, *place) for place in _middle(9, _PAINTED)])
    return perf_counter() - start, roads, peak_memory() * 1e-6


def _middle(level: int, count: int) -> list[tuple[int, int]]:
    """Return a square of tiles in the middle of the sketch."""
    first = (1 << level) // 2 - count // 2
    return [(first + i, first + j) for j in range(count) for i in range(count)]


def _scale_rows(
    terrains: dict[int, Terrain], loads: dict[int, tuple[float, float, float]], rounds: int
) -> Iterator[Row]:
    work = {}
    for level, count in _LEVELS.items():
        painted = [(level, *place) for place in _middle(level, _PAINTED)]
        for side, terrain in terrains.items():
            ground = partial(terrain.evaluator.tiles, _middle(level, count), level)
            work["tile", level, side] = partial(_lap, ground, count * count)
            work["paint", level, side] = partial(
                _lap, partial(terrain.appearance.tiles, painted), len(painted)
            )
    laps = alternate(work, rounds=rounds)
    for side, terrain in terrains.items():
        load, roads, memory = loads[side]
        row: dict[str, Any] = {"curves": curve_count(side), "areas": len(terrain.sketch.vectors["landuse"])}
        row |= {"load_s": load, "roads_s": roads, "memory_mb": memory}
        for (kind, level, of), own in laps.items():
            if of == side:
                row[f"{kind}{level}_ms"] = 1e3 * median(lap.wall for lap in own)
        yield row


def _edit_row(side: int, sketch: Sketch, roads: str, context: TimedContext, count: int) -> Row:
    """Edit corners in view, and compare the result with a terrain built from its sketch."""
    memory, rng = Results(), np.random.default_rng(SEED)
    terrain = build(sketch, device=context, memory=memory)
    middle = 0.5 * EXTENT
    ground = float(terrain.heights(middle, middle))
    camera = Camera((middle - _VIEW / 2, middle, ground + _HIGH), (middle, middle, ground), fov=_FOV)
    view = view_of(camera, SIZE, draw_distance=EXTENT)
    updates = TileUpdates(terrain)
    updates.converge(view)
    seconds, changed = [], []
    for _ in range(count):
        layer, start = _moved(sketch.vectors["landuse"], rng)
        sketch = sketch.replace(vectors={**sketch.vectors, "landuse": layer})
        times = [start, perf_counter()]
        recipe = make_recipe(sketch, memory=memory)
        times.append(perf_counter())
        terrain, areas = terrain.updated(sketch, recipe)
        times.append(perf_counter())
        changed.append(updates.edited(terrain, areas, view))
        seconds.append(np.diff([*times, perf_counter()]))
    laps = 1e3 * np.array(seconds)
    columns = [*laps.T, laps.sum(axis=1)]
    row: dict[str, Any] = {"curves": curve_count(side), "roads": roads, "edits": count}
    row["most"] = float(columns[-1].max())
    for stage, own in zip((*_STAGES, "whole"), columns, strict=True):
        row[f"{stage}_ms"], row[f"{stage}_p95"] = np.percentile(own, (50, 95)).tolist()
    equal = _equal_tiles(terrain, build(sketch, device=context))
    return row | {
        "changed": float(np.mean(changed)),
        "equal": equal,
        "seconds": (1e-3 * columns[-1]).tolist(),
    }


def _moved(layer: FeatureTable, rng: np.random.Generator) -> tuple[FeatureTable, float]:
    """Return a layer after a random corner of the middle was moved, and when that began."""
    low = 0.5 * EXTENT - 0.5 * _VIEW
    near = layer.pieces_near(low, low, low + _VIEW, low + _VIEW)
    vertices = np.concatenate([piece.vertices for piece in near])
    inside = vertices[((vertices > low) & (vertices < low + _VIEW)).all(axis=1)]
    while True:
        x, y = inside[rng.integers(len(inside))].tolist()
        east, north = rng.uniform(-_MOVED, _MOVED, 2).tolist()
        start = perf_counter()
        try:
            return move_node(layer, (x, y), (x + east, y + north)), start
        except InputError:  # an area would touch itself
            continue


def _equal_tiles(one: Terrain, other: Terrain) -> str:
    """Return how many tiles around the middle are equal, of how many."""
    keys = [(level, *place) for level in _LEVELS for place in _middle(level, _PAINTED)]
    painted = zip(*(each.appearance.tiles(keys) for each in (one, other)), strict=True)
    ground = zip(*(each.tiles(keys) for each in (one, other)), strict=True)
    equal = [bool((a == b).all()) for a, b in painted]
    equal += [
        a.height.tobytes() == b.height.tobytes() and a.materials.tobytes() == b.materials.tobytes()
        for a, b in ground
    ]
    return f"{sum(equal)} of {len(equal)}"


def _lap(work: Callable[[], object], tiles: int) -> Lap:
    """Do the work of some tiles once; return the time of one."""
    return Lap(lap(work).wall / tiles)


_PANELS = [
    Curves(title, "curves", lines, units=("curves", unit), scales=("log", "linear"))
    for title, unit, lines in (
        ("Tile of the ground", "ms", {f"level {level}": f"tile{level}_ms" for level in _LEVELS}),
        ("Appearance tile", "ms", {f"level {level}, painted": f"paint{level}_ms" for level in _LEVELS}),
        ("Load", "s", {"all": "load_s", "roads": "roads_s"}),
    )
]
draw_scale = partial(draw_curves, f"{curve_count(SIDE) // 1000},000 curves at one density", _PANELS)
