"""One task of a world, from a terrain on a device to files: the same bytes whoever does it, and when."""

from __future__ import annotations

import time
from dataclasses import dataclass
from hashlib import file_digest
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.export.sampled import normal_bytes
from sketchterrain.export.weights import quantised_weights
from sketchterrain.terrain.ground_bytes import GroundBytes
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.world.forms import plants_of, store_of
from sketchterrain.world.grid import SHARD, Shard
from sketchterrain.world.ground import Ground
from sketchterrain.world.made import Made, WrittenFile
from sketchterrain.world.roots import Roots

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Any

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain.answers import Band
    from sketchterrain.world.job import Job
    from sketchterrain.world.made import Task

__all__ = ["Begun", "Maker", "hashed", "packed", "rounded"]


@dataclass(frozen=True, eq=False)
class Begun:
    """A task whose ground is evaluated, or whose plants are written.

    Attributes
    ----------
    task : Task
    ground : Ground or None
        What is still to be written.
    names : tuple of str
        Files that are.
    seconds : float
        It took so far.
    """

    task: Task
    ground: Ground | None
    names: tuple[str, ...]
    seconds: float


class Maker:
    """Does tasks of a job on a device; one in each process.

    Parameters
    ----------
    job : Job
    context : ComputeContext
        An open device.
    """

    def __init__(self, job: Job, context: ComputeContext) -> None:
        self.job = job
        self.terrain = Terrain(job.sketch, job.recipe, context)
        self._store = store_of(job)
        self._plants = plants_of(job)
        self._roots = Roots.of(job)
        packs = context.device.has_double
        self._window = self.terrain.window_bytes if packs else self._window_here

    def make(self, task: Task) -> Made:
        """Do a task from begin to end.

        Raises
        ------
        DeviceFailedError
            If the device gave up, or computed what is no number.
        SketchterrainError
            If the system cannot write its files.
        """
        return self.end(self.begin(task))

    def begin(self, task: Task) -> Begun:
        """Do what the device is needed for; one task at a time.

        Raises
        ------
        DeviceFailedError
            If the device gave up, or computed what is no number.
        SketchterrainError
            If the system cannot write plants.
        """
        start = time.perf_counter()
        ground, names = None, tuple[str, ...]()
        if task.kind == "ground":
            ground = self.ground(Shard(task.level, task.row, task.column))
        elif self._plants is not None:
            names = self._roots.named_plants(self._plants.write(task, self.terrain))
        return Begun(task, ground, names, time.perf_counter() - start)

    def end(self, begun: Begun) -> Made:
        """Pack, write and hash what `begin` has left to do; in any thread.

        Raises
        ------
        SketchterrainError
            If the system cannot write its files.
        """
        start = time.perf_counter()
        names = begun.names if begun.ground is None else self._store.write(begun.ground)
        files = tuple(hashed(self._roots.path(name), name) for name in names)
        took = time.perf_counter() - start
        parts = {"evaluate": begun.seconds, "write": took}
        return Made(begun.task, files, begun.seconds + took, parts)

    def ground(self, shard: Shard) -> Ground:
        """Evaluate a shard.

        Raises
        ------
        DeviceFailedError
            If the device gave up, or computed what is no number.
        """
        rows, columns = self.job.world.levels[shard.level].size_of(shard)
        top, left = shard.row * SHARD, shard.column * SHARD
        return self.window(shard, top=top, left=left, rows=rows, columns=columns)

    def window(self, shard: Shard, *, top: int, left: int, rows: int, columns: int) -> Ground:
        """Evaluate any window of a shard's level.

        Parameters
        ----------
        shard
            What the ground is taken for.
        top, left, rows, columns
            Of the vertices, in the level.

        Raises
        ------
        DeviceFailedError
            If the device gave up, or computed what is no number.
        """
        world, layers = self.job.world, self.job.layers
        ground = Ground(
            shard,
            np.empty((rows, columns), np.float32),
            np.empty((3 if "normal" in layers else 0, rows, columns), np.uint8),
            np.empty((len(MATERIALS) if "materials" in layers else 0, rows, columns), np.uint8),
        )
        cell, window = world.levels[shard.level].cell, self._window
        for band in window(
            world.west, world.north, cell=cell, left=left, top=top, columns=columns, rows=rows
        ):
            here = slice(band.top, band.top + len(band.height))
            ground.height[here] = rounded(band.height, self.job.step)
            if len(ground.normal):
                ground.normal[:, here] = band.normal
            if len(ground.materials):
                ground.materials[:, here] = band.materials
        return ground

    def _window_here(self, west: float, north: float, **window: Any) -> Iterator[GroundBytes]:
        return packed(self.terrain.window(west, north, **window))


def packed(bands: Iterator[Band]) -> Iterator[GroundBytes]:
    """Return bands as bytes, rounded on the host: the same as a device does it that has 64-bit floats."""
    for band in bands:
        normal, weights = normal_bytes(band.normal), quantised_weights(band.materials)
        yield GroundBytes(band.top, band.height, normal.transpose(2, 0, 1), weights.transpose(2, 0, 1))


def rounded(height: npt.NDArray[np.float32], step: float) -> npt.NDArray[np.float32]:
    """Return heights as multiples of a power of two, both in m; 0 keeps them as they are."""
    if step == 0:
        return height
    # Exact where both are float32; adding 0 makes −0 the 0 that it is.
    return np.asarray(np.rint(height / np.float32(step)) * np.float32(step) + np.float32(0))


def hashed(path: Path, name: str) -> WrittenFile:
    """Return what a file holds.

    Raises
    ------
    OSError
        If it is not there or cannot be read.
    """
    with path.open("rb") as stream:
        digest = file_digest(stream, "sha256").hexdigest()
        return WrittenFile(name, stream.tell(), digest)
