"""How many plants a world has, and how many bytes they become: by where woods can be, and samples."""

from __future__ import annotations

import math
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.world.forms import plants_of
from sketchterrain.world.grid import World
from sketchterrain.world.job import ENDINGS
from sketchterrain.world.made import Task
from sketchterrain.world.samples import evenly

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.terrain import Terrain
    from sketchterrain.world.job import Job

__all__ = ["SampledPlants", "sample_plants"]

_SQUARES: Final = 16
_SEEN, _PARTS = 64e6, 16  # m² that are looked over for woods, and in how many parts
_SIDE, _GRASSY_SIDE = 384.0, 64.0  # m: grass stands a thousand times as close
_WIDER: Final = 4.0  # times as wide are the two that are timed: what a file takes at least counts little


class SampledPlants(NamedTuple):
    """What plants take: how many they are, their bytes on disk, and seconds of one device for all of them."""

    plants: float
    bytes: float
    seconds: float


def sample_plants(job: Job, terrain: Terrain) -> SampledPlants:
    """Have a job's plants written on some squares elsewhere, and weigh them.

    Raises
    ------
    DeviceFailedError
        If the device gave up.
    SketchterrainError
        If the system cannot write temporary files.
    """
    world = job.world
    storeys = ("woody", "grass") if job.grass else ("woody",)
    counts, weights, most = [], [], 0
    squares = _spread(world, _SQUARES, _GRASSY_SIDE if job.grass else _SIDE)
    for square in squares:
        area = (square.west, square.south, square.east, square.north)
        counts.append(sum(len(terrain.foliage(*area, storey=storey)) for storey in storeys))
        most += sum(terrain.foliage_estimate(*area, storey=storey)[0] for storey in storeys)
        weights.append(_weight(job, terrain, square))
    plants = _most(world, terrain, storeys) * sum(counts) / max(most, 1)
    each, empty = _line(counts, weights)
    ends = (squares[int(np.argmin(counts))], squares[int(np.argmax(counts))])
    timed = [_timed(job, terrain, _wider(world, end, _WIDER), each, empty) for end in ends]
    seconds = _seconds(timed, _area(world), plants)
    return SampledPlants(plants, plants * each + math.prod(world.levels[0].shards) * empty, seconds)


class _Timed(NamedTuple):
    """Seconds that the plants of a square took; its m², and how many they are."""

    seconds: float
    area: float
    plants: float


def _timed(job: Job, terrain: Terrain, square: World, each: float, empty: float) -> _Timed:
    start = time.perf_counter()
    weight = _weight(job, terrain, square)
    took = time.perf_counter() - start
    return _Timed(took, _area(square), max(weight - empty, 0.0) / each if each > 0 else 0.0)


def _seconds(timed: Sequence[_Timed], area: float, plants: float) -> float:
    """Return what plants of an area take: so much a m², by the square with fewest, and so much a plant."""
    bare, dense = timed
    apart = dense.plants - bare.plants
    a_plant = max(dense.seconds - bare.seconds, 0.0) / apart if apart > 0 else 0.0
    a_metre = max(bare.seconds - a_plant * bare.plants, 0.0) / bare.area
    return a_metre * area + a_plant * plants


def _wider(world: World, square: World, times: float) -> World:
    """Return a square about the same middle, so many times as wide as far as the world goes."""
    spans = (
        (square.west, square.east, world.west, world.east),
        (square.south, square.north, world.south, world.north),
    )
    ends = []
    for low, high, first, last in spans:
        half = 0.5 * times * (high - low)
        middle = 0.5 * (low + high)
        ends.append((max(middle - half, first), min(middle + half, last)))
    (west, east), (south, north) = ends
    return World(west, south, east, north, min(east - west, north - south))


def _most(world: World, terrain: Terrain, storeys: Sequence[str]) -> float:
    """Return how many plants there can be by where woods are: they stand in few places, and close."""
    places = [world] if _area(world) <= _SEEN else _spread(world, _PARTS, math.sqrt(_SEEN / _PARTS))
    found = sum(
        terrain.foliage_estimate(place.west, place.south, place.east, place.north, storey=storey)[0]
        for place in places
        for storey in storeys
    )
    return found * _area(world) / sum(map(_area, places))


def _spread(world: World, count: int, side: float) -> list[World]:
    """Return rectangles of a world, no wider than a side and spread evenly over it."""
    across, down = min(side, world.east - world.west), min(side, world.north - world.south)
    found = []
    for number in range(count):
        right, up = evenly(number)
        west = world.west + right * (world.east - world.west - across)
        south = world.south + up * (world.north - world.south - down)
        found.append(World(west, south, west + across, south + down, min(across, down)))
    return found


def _area(world: World) -> float:
    """Return square metres."""
    return (world.east - world.west) * (world.north - world.south)


def _line(counts: Sequence[int], weights: Sequence[int]) -> tuple[float, float]:
    """Return the bytes of a plant, and those of a file without any, that fit files best."""
    mean, weight = float(np.mean(counts)), float(np.mean(weights))
    apart = np.asarray(counts) - mean
    spread = float(apart @ apart)
    each = float(apart @ (np.asarray(weights) - weight)) / spread if spread > 0 else 0.0
    each = min(max(each, 0.0), weight / max(mean, 1.0))
    return each, weight - each * mean


def _weight(job: Job, terrain: Terrain, square: World) -> int:
    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
        output = Path(folder) / f"sample{ENDINGS[job.form]}"
        plants = plants_of(replace(job, world=square, output=output))
        if plants is None:
            return 0
        plants.create()
        names = plants.write(Task("plants", 0, 0, 0), terrain)
        return sum((plants.folder / name).stat().st_size for name in names)
