"""Foliage: plants a second."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from sketchterrain.benchmarks.grounds import open_ground
from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import alternate, spread

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import Lap, TimedContext
    from sketchterrain.terrain import Terrain

__all__ = ["measure"]

_PLANT_COLUMNS = (
    Column("preset", "preset"),
    Column("plants", "plants"),
    Column("rounds", "rounds"),
    Column("median_ms", "median, ms"),
    Column("p95_ms", "95 %, ms"),
    Column("device_ms", "on the device, ms"),
    Column("thousand_plants_per_s", "thousand plants/s"),
    Column("hectares_per_s", "ha/s"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
    """Plants a second in the middle of each preset.

    From call to array by the clock, and the launches alone by profiling events. Hectares a second say what a
    scene costs, whatever stands on it. Rounds alternate between the presets.
    """
    works: dict[str, Callable[[], Lap]] = {}
    plants: dict[str, int] = {}
    for name in effort.presets:
        terrain = open_ground(name, context)
        area = _square(terrain, effort.foliage_side)
        works[name] = partial(context.lap, partial(terrain.foliage, *area))
        plants[name] = len(terrain.foliage(*area))
    laps = alternate(works, rounds=effort.rounds)
    rows = tuple(_plant_row(name, plants[name], effort.foliage_side, laps[name]) for name in effort.presets)
    title = f"Plants on {effort.foliage_side:g} × {effort.foliage_side:g} m"
    return Outcome((Table(title, _PLANT_COLUMNS, rows),))


def _square(terrain: Terrain, side: float) -> tuple[float, float, float, float]:
    east, north = terrain.size
    west, south = (east - side) / 2, (north - side) / 2
    return west, south, west + side, south + side


def _plant_row(name: str, plants: int, side: float, laps: list[Lap]) -> Row:
    samples = [lap.wall for lap in laps]
    times, device = spread(samples), spread([lap.device for lap in laps])
    return {
        "preset": name,
        "plants": plants,
        "rounds": times.count,
        "median_ms": times.median * 1e3,
        "p95_ms": times.p95 * 1e3,
        "device_ms": device.median * 1e3,
        "thousand_plants_per_s": plants / times.median * 1e-3,
        "hectares_per_s": side * side * 1e-4 / times.median,
        "seconds": samples,
    }
