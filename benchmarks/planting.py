"""Foliage: plants a second."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from sketchterrain.benchmarks.grounds import open_ground
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import alternate, spread
from sketchterrain.vegetation.plants import STOREYS

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import Lap, TimedContext
    from sketchterrain.terrain.terrain import Terrain

_NARROWER = {"grass": 8}

_PLANT_COLUMNS = (
    Column("preset", "preset"),
    Column("storey", "storey"),
    Column("side", "side, m"),
    Column("plants", "plants"),
    Column("rounds", "rounds"),
    Column("median_ms", "median, ms"),
    Column("p95_ms", "95 %, ms"),
    Column("first_ms", "first time, ms"),
    Column("device_ms", "on the device, ms"),
    Column("thousand_plants_per_s", "thousand plants/s"),
    Column("hectares_per_s", "ha/s"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Plants a second in the middle of each preset, by storey.

    From call to array by the clock, and the launches alone by profiling events; the first call also finds how
    far apart plants stand there, which the terrain keeps. The square of a meadow's plants, of which there are
    hundreds of times as many, is an eighth as wide. Hectares a second say what a scene costs, whatever stands
    on it. Rounds alternate between the presets.
    """
    sides = {name: effort.foliage_side / _NARROWER.get(name, 1) for name in STOREYS}
    works: dict[tuple[str, str], Callable[[], Lap]] = {}
    plants: dict[tuple[str, str], int] = {}
    first: dict[tuple[str, str], Lap] = {}
    for preset in effort.presets:
        terrain = open_ground(preset, context)
        for storey, side in sides.items():
            key, grow = (preset, storey), partial(terrain.foliage, *_square(terrain, side), storey=storey)
            works[key] = partial(context.lap, grow)
            first[key] = works[key]()
            plants[key] = len(grow())
    laps = alternate(works, rounds=effort.rounds)
    rows = []
    for key in works:
        row = _plant_row(plants[key], sides[key[1]], laps[key])
        rows.append({"preset": key[0], "storey": key[1], **row, "first_ms": first[key].wall * 1e3})
    return Outcome((Table("Plants", _PLANT_COLUMNS, tuple(rows)),))


def _square(terrain: Terrain, side: float) -> tuple[float, float, float, float]:
    east, north = terrain.size
    west, south = (east - side) / 2, (north - side) / 2
    return west, south, west + side, south + side


def _plant_row(plants: int, side: float, laps: list[Lap]) -> Row:
    samples = [lap.wall for lap in laps]
    times, device = spread(samples), spread([lap.device for lap in laps])
    return {
        "side": side,
        "plants": plants,
        "rounds": times.count,
        "median_ms": times.median * 1e3,
        "p95_ms": times.p95 * 1e3,
        "device_ms": device.median * 1e3,
        "thousand_plants_per_s": plants / times.median * 1e-3,
        "hectares_per_s": side * side * 1e-4 / times.median,
        "seconds": samples,
    }
