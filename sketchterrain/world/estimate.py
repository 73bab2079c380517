"""What a world will take: disk, memory and time, by samples of that very world, before it is written."""

from __future__ import annotations

import gc
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.batch.remaining import duration
from sketchterrain.batch.room import memory_left
from sketchterrain.compute import ComputeContext, choose_device
from sketchterrain.disk import amount, check_disk, disk_left
from sketchterrain.errors import InputError
from sketchterrain.listings import counted
from sketchterrain.system import memory_in_use
from sketchterrain.world.begun import there
from sketchterrain.world.grid import Shard
from sketchterrain.world.making import Maker
from sketchterrain.world.plant_samples import sample_plants
from sketchterrain.world.samples import sample
from sketchterrain.world.tasks import task_count

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.compute import Device
    from sketchterrain.world.job import Job
    from sketchterrain.world.plant_samples import SampledPlants
    from sketchterrain.world.samples import Sampled

__all__ = ["Estimate", "estimate", "in_words"]

# Measured with every layer: launches and what they return, of so many vertices at once; a shard that is
# evaluated and one that is written.
_LAUNCHED: Final = 1 << 20
_BYTES_LAUNCHED: Final = 92
_BYTES_A_VERTEX: Final = 38
_OPENING, _STARTING = 0.5, 3.0  # s: a device and its programs; processes of workers
_JOINING: Final = 1.0  # of one GeoTIFF a layer: how much of it lies there twice while it is joined


@dataclass(frozen=True)
class Estimate:
    """What a world takes.

    Attributes
    ----------
    job : Job
    sampled : Sampled
    plants : SampledPlants or None
    device : Device
        What it was sampled on.
    tasks, done : int
        All, and those whose files are there already.
    there : int
        Bytes that are.
    workers : int
        Processes that do it at once on this machine; 0: this one alone; −1: others' machines.
    memory : float
        Bytes that are in use at once, by all of these processes.
    memory_left, disk_left : int
        What there is.
    """

    job: Job
    sampled: Sampled
    plants: SampledPlants | None
    device: Device
    tasks: int
    done: int
    there: int
    workers: int
    memory: float
    memory_left: int
    disk_left: int

    @property
    def disk(self) -> dict[str, float]:
        """Bytes by layer, of plants and of the rest, in the end."""
        plants = {} if self.plants is None else {"plants": self.plants.bytes}
        return {**self.sampled.layers, **plants, "metadata": float(self.sampled.fixed)}

    @property
    def disk_needed(self) -> float:
        """Bytes that are still to be written, at most at once."""
        whole = sum(self.disk.values())
        joining = _JOINING * whole if self.job.form == "tif" else 0.0
        return max(whole + joining - self.there, 0.0)

    @property
    def device_seconds(self) -> float:
        """What one device like the sampled one takes for all of it."""
        sampled, vertices = self.sampled, self.job.world.vertices
        # A processor that evaluates has no time to write meanwhile; another device leaves it free.
        if self.device.type == "CPU":
            each = sampled.evaluating + sampled.writing
        else:
            each = max(sampled.evaluating, sampled.writing)
        return each * vertices + (0.0 if self.plants is None else self.plants.seconds)

    @property
    def seconds(self) -> float:
        """Until what is left is done: workers share a processor, other devices they have one each."""
        at_once = self.workers if self.workers > 0 and self.device.type != "CPU" else 1
        left = self.device_seconds * (1.0 - self.done / max(self.tasks, 1)) / at_once
        return left + _OPENING + (_STARTING if self.workers > 0 else 0.0)

    def refuse_impossible(self) -> None:
        """Refuse a world that there is no room for.

        Raises
        ------
        InputError
            With what it needs and what is left.
        """
        check_disk(self.job.output, self.disk_needed, "the world's files")
        if self.workers >= 0 and self.memory > self.memory_left:
            raise InputError(
                f"the world needs about {amount(self.memory)} of memory at once, {amount(self.memory_left)} "
                "are left"
            )

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        world, finest = self.job.world, self.job.world.levels[0]
        return {
            "output": str(self.job.output),
            "form": self.job.form,
            "bounds": [world.west, world.south, world.east, world.north],
            "cell": world.cell,
            "columns": finest.columns,
            "rows": finest.rows,
            "levels": len(world.levels),
            "vertices": world.vertices,
            "tasks": self.tasks,
            "done": self.done,
            "disk": {
                "parts": {name: round(value) for name, value in self.disk.items()},
                "needed": round(self.disk_needed),
                "there": self.there,
                "left": self.disk_left,
            },
            "plants": None if self.plants is None else round(self.plants.plants),
            "memory": {"needed": round(self.memory), "left": self.memory_left},
            "seconds": {"about": round(self.seconds, 1), "of_one_device": round(self.device_seconds, 1)},
            "sampled": {
                "device": self.device.name,
                "patches": self.sampled.patches,
                "vertices": self.sampled.vertices,
                "vertices_a_second": round(1.0 / self.sampled.evaluating),
            },
        }

    def lines(self) -> list[str]:
        """Return it for a person."""
        world, finest = self.job.world, self.job.world.levels[0]
        samples = counted(self.sampled.patches, "sample")
        parts = ", ".join(f"{name} {amount(value)}" for name, value in self.disk.items())
        there = f", {amount(self.there)} are there" if self.there else ""
        twice = ", twice while it is joined" if self.job.form == "tif" else ""
        done = f", {self.done} of them done" if self.done else ""
        of_all = {0: "", -1: ", on each worker's machine its own"}.get(
            self.workers, f", by {counted(self.workers, 'worker')}"
        )
        of_one = " of one worker like this machine" if self.workers < 0 else ""
        lines = [
            f"world: {finest.columns} × {finest.rows} vertices {world.cell:g} m apart, "
            f"{counted(len(world.levels), 'level')}, {in_words(world.vertices)} vertices in all, "
            f"{counted(self.tasks, 'task')}{done}",
            f"disk: about {amount(sum(self.disk.values()))}{twice}{there}, {amount(self.disk_left)} are left",
            f"  {parts}",
            f"memory: about {amount(self.memory)} at once{of_all}, {amount(self.memory_left)} are left",
            f"time: about {duration(self.seconds)}{of_one}, by {samples} of this world on "
            f"{self.device.name}: {in_words(1.0 / self.sampled.evaluating)} vertices a second",
        ]
        if self.plants is not None:
            lines.insert(3, f"  about {in_words(self.plants.plants)} plants")
        return lines


def estimate(
    job: Job,
    *,
    device: str | None = None,
    workers: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Estimate:
    """Sample a world and return what it will take; nothing is written where it will be.

    Parameters
    ----------
    job
    device
        Selector as for :func:`~sketchterrain.compute.choose_device`.
    workers
        As `Estimate` has them.
    progress
        Called with the share that is done, 0 … 1.

    Raises
    ------
    DeviceError
        If there is no such device, or it gave up.
    InputError
        If there is another world already.
    SketchterrainError
        If the system cannot write temporary files.
    """
    done, bytes_there = there(job)
    context = ComputeContext(choose_device(device), fast=job.fast)
    maker = Maker(job, context)
    sampled = sample(job, maker, progress=progress)
    plants = None if job.plants == "none" else sample_plants(job, maker.terrain)
    del maker
    gc.collect()  # terrains hold themselves in cycles
    vertices = _largest(job)
    each = memory_in_use() + _BYTES_LAUNCHED * min(vertices, _LAUNCHED) + _BYTES_A_VERTEX * vertices
    return Estimate(
        job=job,
        sampled=sampled,
        plants=plants,
        device=context.device,
        tasks=task_count(job),
        done=done,
        there=bytes_there,
        workers=workers,
        memory=each * max(workers, 1) + (memory_in_use() if workers else 0),
        memory_left=memory_left(),
        disk_left=disk_left(job.output),
    )


def in_words(count: float) -> str:
    """Return a number as a person reads it.

    >>> in_words(12345.6), in_words(1.4e9)
    ('12 346', '1400 million')
    """
    return f"{count:,.0f}".replace(",", " ") if count < 1e6 else f"{count / 1e6:.4g} million"


def _largest(job: Job) -> int:
    """Return how many vertices the largest shard has."""
    levels = job.world.levels
    return max(math.prod(level.size_of(Shard(level.number, 0, 0))) for level in levels)
