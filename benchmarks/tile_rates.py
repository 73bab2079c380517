"""Tiles: vertices a second in batches, against the bound of what they are made of."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.grounds import BARE, central_keys, open_ground
from sketchterrain.benchmarks.noise import OCTAVES, NoiseGrid
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.tile_bound import BYTES, KINDS, counted, probes, slope
from sketchterrain.benchmarks.timing import alternate, spread
from sketchterrain.terrain.lattice import QUADS
from sketchterrain.terrain.terrain import Terrain

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.grounds import TileKey
    from sketchterrain.benchmarks.tile_bound import Counts
    from sketchterrain.benchmarks.timing import Lap, TimedContext

LEVEL = 5
"""256 tiles of it lie within a sketch; on the presets a cell is 1.5 to 8 m."""

ASKED = {"bare": 0.75, "features": 0.5}
"""Shares of the bound that tiles shall reach, without features and with the presets' own."""

_VERTICES = (QUADS + 1) ** 2
_SETS = 64  # of writes, so that groups are whole

_RATES = (
    Column("ground", "ground"),
    Column("batch", "tiles a launch"),
    Column("tiles", "tiles"),
    Column("rounds", "rounds"),
    Column("launch_rate", "launches alone, M vertices/s"),
    Column("filled_rate", "into a store, M vertices/s"),
    Column("total_rate", "with download, M vertices/s"),
    Column("launch_us", "launches, µs a tile"),
    Column("filled_us", "into a store, µs a tile"),
    Column("filled_p95_us", "95 %, µs a tile"),
    Column("total_us", "with download, µs a tile"),
    Column("total_p95_us", "95 %, µs a tile"),
    Column("of_single", "into a store, × a launch a tile"),
)
_BOUND = (
    Column("ground", "ground"),
    Column("tiles", "tiles"),
    Column("octaves", "octaves a vertex"),
    Column("evaluations", "features a vertex"),
    Column("octaves_us", "octaves, µs a tile"),
    Column("evaluations_us", "features, µs a tile"),
    Column("rules_us", "materials, µs a tile"),
    Column("bytes_us", "bytes, µs a tile"),
    Column("bound_us", "bound, µs a tile"),
    Column("launch_us", "launches, µs a tile"),
    Column("launch_p95_us", "95 %, µs a tile"),
    Column("filled_us", "into a store, µs a tile"),
    Column("share", "bound / launches"),
    Column("filled_share", "bound / into a store"),
    Column("asked", "asked"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Million vertices a second of tiles of 64 quads, with all they carry, by the size of the batch.

    The same tiles around the middle of the sketch are evaluated one, 16, 64 or 256 a launch: the launches
    alone by profiling events; from call until they stand in a store on the device, and from call to arrays in
    memory, by the clock. A tile counts 65² vertices; the border that it computes on top for its normals is
    part of its cost. Rounds alternate between the sizes.

    The second table holds the largest batch against what it must cost at least: its octaves at the rate of
    `bench_fbm` and `bench_fbm_slope`, its evaluations of features, lakes and arcs at what one more of each
    adds to a launch, gullies likewise, the materials' rules at what they add, and its 64 bytes a vertex at
    the rate of `bench_write`: all timed in the same rounds. Counted are the tile's own vertices and its
    parent's, each with the border of one that normals are made of; the normals themselves, padding, what
    passes between kernels and what joins features are not.
    """
    rates: list[Row] = []
    for ground, tiles in effort.tile_counts:
        terrain = open_ground(ground, context)
        keys = central_keys(LEVEL, tiles)
        batches = [batch for batch in effort.tile_batches if batch <= tiles]
        works: dict[tuple[int, bool], Callable[[], Lap]] = {
            (batch, stored): _work(context, terrain, keys, batch, stored=stored)
            for batch in batches
            for stored in (True, False)
        }
        laps = alternate(works, rounds=effort.rounds)
        single = spread([lap.wall for lap in laps[1, True]]).median
        rates += [_rate(ground, batch, tiles, laps, single) for batch in batches]
    bound = _bound(context, effort)
    return Outcome((Table(f"Tiles of level {LEVEL}", _RATES, tuple(rates)), bound))


def _work(
    context: TimedContext, terrain: Terrain, keys: Sequence[TileKey], batch: int, *, stored: bool
) -> Callable[[], Lap]:
    store = terrain.tile_store(batch)

    def in_batches() -> None:
        for first in range(0, len(keys), batch):
            part = keys[first : first + batch]
            if stored:
                terrain.fill_tiles(part, store, range(len(part)))
            else:
                terrain.tiles(part)
        context.download(store.ground, 1, context.real_dtype)

    return lambda: context.lap(in_batches)


def _rate(
    ground: str, batch: int, tiles: int, laps: Mapping[tuple[int, bool], Sequence[Lap]], single: float
) -> Row:
    filled = spread([lap.wall for lap in laps[batch, True]])
    launches = spread([lap.device for lap in laps[batch, True]])
    total = spread([lap.wall for lap in laps[batch, False]])
    return {
        "ground": ground,
        "batch": batch,
        "tiles": tiles,
        "rounds": total.count,
        "launch_rate": tiles * _VERTICES / launches.median * 1e-6,
        "filled_rate": tiles * _VERTICES / filled.median * 1e-6,
        "total_rate": tiles * _VERTICES / total.median * 1e-6,
        "launch_us": launches.median / tiles * 1e6,
        "filled_us": filled.median / tiles * 1e6,
        "filled_p95_us": filled.p95 / tiles * 1e6,
        "total_us": total.median / tiles * 1e6,
        "total_p95_us": total.p95 / tiles * 1e6,
        "of_single": single / filled.median,
        "launch_seconds": [lap.device for lap in laps[batch, True]],
        "filled_seconds": [lap.wall for lap in laps[batch, True]],
        "total_seconds": [lap.wall for lap in laps[batch, False]],
    }


def _bound(context: TimedContext, effort: Effort) -> Table:
    """Hold tiles of each ground against what they are made of, all timed in the same rounds."""
    tiles = max(effort.tile_batches)
    tiles = min(tiles, max(count for _, count in effort.tile_counts))
    keys = central_keys(LEVEL, tiles)
    side = int(np.ceil(np.sqrt(tiles))) * (QUADS + 1)
    grid = NoiseGrid(context, side)
    found = probes(context)
    grounds = {name: open_ground(name, context) for name in (BARE, *effort.presets)}
    works: dict[object, Callable[[], Lap]] = {key: probe.lap for key, probe in found.items()}
    works["octaves"] = partial(context.lap, grid.launch)
    works["slopes"] = partial(context.lap, grid.launch_slope)
    works["bytes"] = _writes(context, tiles)
    for name, terrain in grounds.items():
        works[name, "tiles"] = _work(context, terrain, keys, tiles, stored=True)
        bald = Terrain(terrain.sketch, replace(terrain.recipe, material_rules=()), context)
        works[name, "no rules"] = _work(context, bald, keys, tiles, stored=True)
    laps = alternate(works, rounds=effort.rounds)
    octave, sloped = (
        spread([lap.device for lap in laps[name]]).median / (side**2 * OCTAVES)
        for name in ("octaves", "slopes")
    )
    unit = {
        kind: slope(found[kind, False], found[kind, True], (laps[kind, False], laps[kind, True]))
        for kind in (*KINDS, "gully")
    }
    written = spread([lap.device for lap in laps["bytes"]]).median
    rows: list[Row] = []
    for name, terrain in grounds.items():
        counts = counted(terrain, context, keys)
        seconds = {
            "octaves": counts.octaves * octave + counts.slopes * sloped + counts.gullies * unit["gully"],
            "evaluations": sum(counts.evaluations[kind] * unit[kind] for kind in KINDS),
            "rules": max(_surfaces(laps[name, "tiles"]) - _surfaces(laps[name, "no rules"]), 0.0),
            "bytes": written,
        }
        rows.append(_share(name, tiles, counts, seconds, laps[name, "tiles"]))
    return Table("Tiles against their bound", _BOUND, tuple(rows))


def _share(name: str, tiles: int, counts: Counts, seconds: Mapping[str, float], laps: Sequence[Lap]) -> Row:
    """Return the row of a ground: the seconds of its parts beside those of its tiles."""
    whole = sum(seconds.values())
    launches, filled = (spread([getattr(lap, clock) for lap in laps]) for clock in ("device", "wall"))
    return {
        "ground": name,
        "tiles": tiles,
        "octaves": (counts.octaves + counts.slopes + counts.gullies) / counts.vertices,
        "evaluations": sum(counts.evaluations.values()) / counts.vertices,
        **{f"{part}_us": value / tiles * 1e6 for part, value in seconds.items()},
        "bound_us": whole / tiles * 1e6,
        "launch_us": launches.median / tiles * 1e6,
        "launch_p95_us": launches.p95 / tiles * 1e6,
        "filled_us": filled.median / tiles * 1e6,
        "share": whole / launches.median,
        "filled_share": whole / filled.median,
        "asked": ASKED["bare" if name == BARE else "features"],
        "launch_seconds": [lap.device for lap in laps],
    }


def _writes(context: TimedContext, tiles: int) -> Callable[[], Lap]:
    """Write as many bytes as the tiles have, and nothing else."""
    items = -(-tiles * _VERTICES * BYTES // (16 * _SETS)) * _SETS
    out = context.empty(4 * items, np.float32)
    return partial(
        context.lap, partial(context.launch, "bench_bytes.cl", "bench_write", (items,), out, group=(_SETS,))
    )


def _surfaces(laps: Sequence[Lap]) -> float:
    """Median device time of the launches that make normals and weights."""
    return spread([one.seconds for lap in laps for one in lap.launches if one.kernel == "surfaces"]).median
