"""Tiles: vertices a second in batches."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.benchmarks.grounds import central_keys, open_ground
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import alternate, spread
from sketchterrain.terrain.lattice import QUADS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.grounds import TileKey
    from sketchterrain.benchmarks.timing import Lap, TimedContext
    from sketchterrain.terrain import Terrain

__all__ = ["LEVEL", "measure"]

LEVEL = 5
"""256 tiles of it lie within a sketch; on the presets a cell is 1.5 to 8 m."""

_VERTICES = (QUADS + 1) ** 2

_COLUMNS = (
    Column("ground", "ground"),
    Column("batch", "tiles a launch"),
    Column("tiles", "tiles"),
    Column("rounds", "rounds"),
    Column("launch_rate", "launches alone, M vertices/s"),
    Column("total_rate", "with download, M vertices/s"),
    Column("launch_us", "launches, µs a tile"),
    Column("total_us", "with download, µs a tile"),
    Column("total_p95_us", "95 %, µs a tile"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Million vertices a second of tiles of 64 quads, with normals and materials, by the size of the batch.

    The same tiles around the middle of the sketch are evaluated one, 16, 64 or 256 a launch: the launches
    alone by profiling events, and from call to arrays in memory by the clock. A tile counts 65² vertices; the
    border that it computes on top for its normals is part of its cost. Rounds alternate between the sizes.
    """
    rows: list[Row] = []
    for ground, tiles in effort.tile_counts:
        terrain = open_ground(ground, context)
        keys = central_keys(LEVEL, tiles)
        batches = [batch for batch in effort.tile_batches if batch <= tiles]
        works = {str(batch): _work(context, terrain, keys, batch) for batch in batches}
        laps = alternate(works, rounds=effort.rounds)
        rows += [_row(ground, batch, tiles, laps[str(batch)]) for batch in batches]
    return Outcome((Table(f"Tiles of level {LEVEL}", _COLUMNS, tuple(rows)),))


def _work(context: TimedContext, terrain: Terrain, keys: Sequence[TileKey], batch: int) -> Callable[[], Lap]:
    def in_batches() -> None:
        for first in range(0, len(keys), batch):
            terrain.tiles(keys[first : first + batch])

    return lambda: context.lap(in_batches)


def _row(ground: str, batch: int, tiles: int, laps: Sequence[Lap]) -> Row:
    launches, total = spread([lap.device for lap in laps]), spread([lap.wall for lap in laps])
    return {
        "ground": ground,
        "batch": batch,
        "tiles": tiles,
        "rounds": total.count,
        "launch_rate": tiles * _VERTICES / launches.median * 1e-6,
        "total_rate": tiles * _VERTICES / total.median * 1e-6,
        "launch_us": launches.median / tiles * 1e6,
        "total_us": total.median / tiles * 1e6,
        "total_p95_us": total.p95 / tiles * 1e6,
        "launch_seconds": [lap.device for lap in laps],
        "total_seconds": [lap.wall for lap in laps],
    }
