"""What a world takes: disk and memory, from its vertices and its area."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from sketchterrain.estimate import Estimate, count_text, layer_disk, plant_disk
from sketchterrain.listings import counted
from sketchterrain.world.grid import Shard
from sketchterrain.world.job import Job
from sketchterrain.world.resume import load_state
from sketchterrain.world.store import store_of
from sketchterrain.world.tasks import task_count

# Bytes, measured with every layer: a process with an open device, what kernels work on of so many vertices
# at once, and a shard that is evaluated and one that is written.
_PROCESS: Final = 280 << 20
_LAUNCHED: Final = 1 << 20
_BYTES_LAUNCHED: Final = 92
_BYTES_A_VERTEX: Final = 56


@dataclass(frozen=True)
class WorldEstimate:
    """What a world takes, and how many of its tasks are done."""

    job: Job
    needs: Estimate
    tasks: int
    done: int

    def refuse_impossible(self) -> None:
        """Raise InputError if the disk or the memory will not do."""
        self.needs.check(self.job.output, "the world's files")

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
            **self.needs.as_dict(self.job.output),
        }

    def lines(self) -> list[str]:
        """Return it as text."""
        world, finest = self.job.world, self.job.world.levels[0]
        done = f", {self.done} of them done" if self.done else ""
        return [
            f"world: {finest.columns} × {finest.rows} vertices {world.cell:g} m apart, "
            f"{counted(len(world.levels), 'level')}, {count_text(world.vertices)} vertices in all, "
            f"{counted(self.tasks, 'shard')}{done}",
            *self.needs.lines(self.job.output),
        ]


def estimate_world(job: Job, *, workers: int = 0) -> WorldEstimate:
    """Return what a job takes, by `workers` processes of this machine (0: this one).

    Raises InputError if there is another world at the output.
    """
    world = job.world
    disk = layer_disk(world.vertices, job.layers)
    if job.step:
        disk["height"] *= 0.4
    if job.form == "tif":
        disk["temporary"] = sum(disk.values())  # shards, until they are joined
    if job.plants != "none":
        disk["plants"] = plant_disk(_planted_area(job), job.plants, grass=job.grass)
    vertices = max(math.prod(level.size_of(Shard(level.number, 0, 0))) for level in world.levels)
    each = _PROCESS + _BYTES_LAUNCHED * min(vertices, _LAUNCHED) + _BYTES_A_VERTEX * vertices
    memory = each * max(workers, 1) + (_PROCESS if workers else 0)
    state = load_state(job, store_of(job))
    done, present = (0, 0) if state is None else (len(state.ledger.done), state.bytes)
    return WorldEstimate(job, Estimate(disk, memory, present), task_count(job), done)


def _planted_area(job: Job) -> float:
    """Return the area (m²) where plants may grow: that of the world within the sketch."""
    east, north = job.sketch.size
    across = min(job.world.east, east) - max(job.world.west, 0.0)
    down = min(job.world.north, north) - max(job.world.south, 0.0)
    return max(across, 0.0) * max(down, 0.0)
