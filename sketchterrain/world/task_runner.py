"""One task of a world, from a terrain on a device to files: the same bytes on every device."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import file_digest
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.compute import ComputeContext
from sketchterrain.export.sampled import normal_bytes
from sketchterrain.export.weights import quantised_weights
from sketchterrain.terrain.answers import Band
from sketchterrain.terrain.ground_bytes import GroundBytes
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.world.grid import SHARD, Shard
from sketchterrain.world.ground import Ground
from sketchterrain.world.job import Job
from sketchterrain.world.journal import OutputLayout
from sketchterrain.world.store import plants_of, store_of
from sketchterrain.world.tasks import Task, TaskResult, WrittenFile


@dataclass(frozen=True, eq=False)
class PendingTask:
    """A task whose ground is evaluated but not written, or whose plants are written already (`names`)."""

    task: Task
    ground: Ground | None
    names: tuple[str, ...]
    seconds: float


class TaskRunner:
    """Runs tasks of a job on one device.

    `evaluate` needs the device and takes one task at a time; `finish` may run in any thread. A device that
    gives up or computes non-finite heights raises DeviceFailedError; a file that cannot be written raises
    SketchterrainError.
    """

    def __init__(self, job: Job, context: ComputeContext) -> None:
        self.job = job
        self.terrain = Terrain(job.sketch, job.recipe, context)
        self._store = store_of(job)
        self._plants = plants_of(job)
        self._layout = OutputLayout.of(job)
        self._window = self.terrain.window_bytes if context.device.has_double else self._window_on_host

    def evaluate(self, task: Task) -> PendingTask:
        """Do the part of a task that needs the device."""
        start = time.perf_counter()
        ground, names = None, tuple[str, ...]()
        if task.kind == "ground":
            ground = self.ground(Shard(task.level, task.row, task.column))
        elif self._plants is not None:
            names = self._layout.plant_names(self._plants.write(task, self.terrain))
        return PendingTask(task, ground, names, time.perf_counter() - start)

    def finish(self, pending: PendingTask) -> TaskResult:
        """Pack, write and hash what `evaluate` has left to do."""
        start = time.perf_counter()
        names = pending.names if pending.ground is None else self._store.write(pending.ground)
        files = tuple(file_record(self._layout.path(name), name) for name in names)
        took = time.perf_counter() - start
        parts = {"evaluate": pending.seconds, "write": took}
        return TaskResult(pending.task, files, pending.seconds + took, parts)

    def ground(self, shard: Shard) -> Ground:
        """Evaluate a shard."""
        world, layers = self.job.world, self.job.layers
        level = world.levels[shard.level]
        rows, columns = level.size_of(shard)
        ground = Ground(
            shard,
            np.empty((rows, columns), np.float32),
            np.empty((3 if "normal" in layers else 0, rows, columns), np.uint8),
            np.empty((len(MATERIALS) if "materials" in layers else 0, rows, columns), np.uint8),
        )
        for band in self._window(
            world.west,
            world.north,
            cell=level.cell,
            left=shard.column * SHARD,
            top=shard.row * SHARD,
            columns=columns,
            rows=rows,
        ):
            here = slice(band.top, band.top + len(band.height))
            ground.height[here] = rounded(band.height, self.job.step)
            if len(ground.normal):
                ground.normal[:, here] = band.normal
            if len(ground.materials):
                ground.materials[:, here] = band.materials
        return ground

    def _window_on_host(self, west: float, north: float, **window: Any) -> Iterator[GroundBytes]:
        return packed(self.terrain.window(west, north, **window))


def packed(bands: Iterator[Band]) -> Iterator[GroundBytes]:
    """Yield bands as bytes, rounded on the host: the same as a device with 64-bit floats does it."""
    for band in bands:
        normal, weights = normal_bytes(band.normal), quantised_weights(band.materials)
        yield GroundBytes(band.top, band.height, normal.transpose(2, 0, 1), weights.transpose(2, 0, 1))


def rounded(height: npt.NDArray[np.float32], step: float) -> npt.NDArray[np.float32]:
    """Return heights as multiples of a power of two, both in m; 0 keeps them as they are."""
    if step == 0:
        return height
    # Exact where both are float32; adding 0 turns −0 into 0.
    return np.asarray(np.rint(height / np.float32(step)) * np.float32(step) + np.float32(0))


def file_record(path: Path, name: str) -> WrittenFile:
    """Return the length and the hash of a file; raise OSError if it cannot be read."""
    with path.open("rb") as stream:
        digest = file_digest(stream, "sha256").hexdigest()
        return WrittenFile(name, stream.tell(), digest)
