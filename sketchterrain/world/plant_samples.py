"""How many plants a world has, and how many bytes they become: counted on some squares at hashed places."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.world.forms import plants_of
from sketchterrain.world.grid import World
from sketchterrain.world.made import Task

if TYPE_CHECKING:
    from sketchterrain.terrain import Terrain
    from sketchterrain.world.job import Job

__all__ = ["SampledPlants", "sample_plants"]

_SQUARES: Final = 16
_SIDE, _GRASSY_SIDE = 512.0, 96.0  # m: grass stands a thousand times as close


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
    side = _GRASSY_SIDE if job.grass else _SIDE
    across, down = min(side, world.east - world.west), min(side, world.north - world.south)
    chance = np.random.default_rng(job.sketch.seed)
    count, weight, start = 0, 0, time.perf_counter()
    for _ in range(_SQUARES):
        west = float(chance.uniform(world.west, max(world.east - across, world.west)))
        south = float(chance.uniform(world.south, max(world.north - down, world.south)))
        for storey in ("woody", "grass") if job.grass else ("woody",):
            count += len(terrain.foliage(west, south, west + across, south + down, storey=storey))
        weight += _weight(job, terrain, World(west, south, west + across, south + down, min(across, down)))
    times = (world.east - world.west) * (world.north - world.south) / (_SQUARES * across * down)
    # Each square is made twice: counted, and written.
    return SampledPlants(count * times, weight * times, 0.5 * (time.perf_counter() - start) * times)


def _weight(job: Job, terrain: Terrain, square: World) -> int:
    with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
        output = Path(folder) / f"sample{'.zarr' if job.form == 'zarr' else ''}"
        plants = plants_of(replace(job, world=square, output=output))
        if plants is None:
            return 0
        plants.create()
        names = plants.write(Task("plants", 0, 0, 0), terrain)
        return sum((plants.folder / name).stat().st_size for name in names)
