"""Terrain on elevation data: tiles beside those without, and a flight with the patches that it uploads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np

from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.flight_scene import RATE, OwnTiles, Stop, view_of
from sketchterrain.benchmarks.report import Column, Row, Table
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate
from sketchterrain.document.rasters import raster_source
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.importing.elevation import sketch_on_elevation
from sketchterrain.render.camera import Camera
from sketchterrain.terrain.layers.base import PatchSlotBuffers

_PRESET = "andorra"
_TILES = 64  # of a level that are timed
_SPEED, _ABOVE, _AHEAD = 160.0, 600.0, 4000.0  # m/s, m above the ground, m to what the eye looks at
_SECONDS, _BUDGET = 10.0, 8e-3  # of the flight; s a frame for generation
_ASKED_TILES, _ASKED_BYTES = 1.3, 1600.0
_PATCH_BYTES: Final = 35 * 35 * 5 + 24 * 4 + 16

_TILE_COLUMNS = (
    Column("level", "level"),
    Column("cell", "cell, m"),
    Column("without_ms", "without data, ms"),
    Column("smooth_ms", "with data, ms"),
    Column("ms", "with detail, ms"),
    Column("smooth", "with ÷ without"),
    Column("ratio", "with detail ÷ without"),
    Column("asked", "asked: at most"),
)
_FLIGHT_COLUMNS = (
    Column("grid", "grid"),
    Column("first_ms", "first view, ms"),
    Column("frames", "frames"),
    Column("ms", "ms a frame: choice and generation"),
    Column("slow_ms", "95 % within, ms"),
    Column("tiles", "tiles a frame"),
    Column("first_patches", "patches of the first view"),
    Column("bytes", "bytes of patches a frame"),
    Column("asked", "the paper: at most"),
)


def tile_times(context: TimedContext, effort: Effort) -> Table:
    """Time tiles of the preset `andorra`, without its data, with them, and with detail below them."""
    sketch = load_sketch(_PRESET)
    smooth = sketch.replace(base={**sketch.base, "detail": 0.0})
    terrains = {
        name: build(each, device=context)
        for name, each in (("without", sketch.replace(rasters=())), ("smooth", smooth), ("detail", sketch))
    }
    rows = []
    for level in (4, 6, 8, 10):
        side = 1 << level
        first = side // 2 - 4
        keys = [(first + column, first + row) for row in range(8) for column in range(8)][:_TILES]
        work = {name: partial(_lap, context, each, keys, level) for name, each in terrains.items()}
        laps = alternate(work, rounds=effort.rounds)
        times = {name: 1e3 * median(lap.wall for lap in each) for name, each in laps.items()}
        rows.append(
            {
                "level": level,
                "cell": sketch.extent / (64 << level),
                "without_ms": times["without"],
                "smooth_ms": times["smooth"],
                "ms": times["detail"],
                "smooth": times["smooth"] / times["without"],
                "ratio": times["detail"] / times["without"],
                "asked": _ASKED_TILES,
            }
        )
    return Table(f"{_TILES} tiles of {_PRESET}", _TILE_COLUMNS, tuple(rows))


def _lap(context: TimedContext, terrain: Terrain, keys: list[tuple[int, int]], level: int) -> Lap:
    return context.lap(lambda: terrain.evaluator.tiles(keys, level))


def flight(context: TimedContext, path: Path, side: int) -> Row:
    """Fly over a DEM of side × side samples, 160 m/s, 600 m above it, tiles within 1 px of 720."""
    sketch, _ = sketch_on_elevation([raster_source(path, "elevation")])
    terrain = build(sketch, device=context)
    tiles = OwnTiles(terrain, quads=64, tolerance=1.0)
    stops = list(_stops(terrain))
    with _counted() as uploaded:
        first = tiles.converge(view_of(stops[0], terrain.extent))
        patches = sum(uploaded)
        uploaded.clear()
        frames = [
            tiles.frame(view_of(stop, terrain.extent), elapsed=1.0 / RATE, budget=_BUDGET) for stop in stops
        ]
    seconds = np.array([each.generation + each.choice for each in frames])
    return {
        "grid": f"{side}²",
        "first_ms": 1e3 * (first.generation + first.choice),
        "frames": len(frames),
        "ms": 1e3 * float(seconds.mean()),
        "slow_ms": 1e3 * float(np.quantile(seconds, 0.95)),
        "tiles": float(np.mean([each.tiles for each in frames])),
        "first_patches": patches,
        "bytes": _PATCH_BYTES * sum(uploaded) / len(frames),
        "asked": _ASKED_BYTES,
    }


def flight_table(rows: tuple[Row, ...]) -> Table:
    """Return the table of flights."""
    return Table(f"Flights at {_SPEED:.0f} m/s, {RATE:.0f} frames a second", _FLIGHT_COLUMNS, rows)


def _stops(terrain: Terrain) -> Iterator[Stop]:
    """Yield the frames of a straight flight along the sketch's diagonal."""
    along = _SPEED * np.arange(round(_SECONDS * RATE)) / RATE
    middle = 0.5 * np.array(terrain.size)
    ahead = np.array([0.8, 0.6])
    eyes = middle + (along - along.mean())[:, None] * ahead
    ground = terrain.heights(*eyes.T, cell_size=_ABOVE / 4.0).astype(np.float64)
    height = np.convolve(np.pad(ground, 60, mode="edge"), np.ones(121) / 121.0, mode="valid") + _ABOVE
    velocity = (*(_SPEED * ahead).tolist(), 0.0)
    for eye, top, below in zip(eyes, height.tolist(), ground.tolist(), strict=True):
        target = eye + _AHEAD * ahead
        camera = Camera((*eye.tolist(), top), (*target.tolist(), below), fov=45.0)
        yield Stop(camera, below, velocity)


@contextmanager
def _counted() -> Iterator[list[int]]:
    """Collect how many patches are uploaded at a time."""
    counts: list[int] = []
    upload = PatchSlotBuffers._upload

    def counted(buffers: PatchSlotBuffers, numbers: np.ndarray, slots: np.ndarray) -> None:
        counts.append(len(numbers))
        upload(buffers, numbers, slots)

    PatchSlotBuffers._upload = counted  # type: ignore[assignment, method-assign]
    try:
        yield counts
    finally:
        PatchSlotBuffers._upload = upload  # type: ignore[method-assign]
