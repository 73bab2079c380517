"""Tasks of a world: what is computed and written at once, and the files that come of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

from sketchterrain.world.grid import SHARD
from sketchterrain.world.job import Job


class Task(NamedTuple):
    """One file of each layer (``ground``) or one of plants; no task needs another.

    `level`, `row` and `column` name a shard. Plants have level 0 and lie in that shard's rectangle.
    """

    kind: Literal["ground", "plants"]
    level: int
    row: int
    column: int


class WrittenFile(NamedTuple):
    """A file's name from the output's folder on, with ``/``; its length and SHA-256."""

    file: str
    bytes: int
    sha256: str


@dataclass(frozen=True)
class TaskResult:
    """A finished task: its files, seconds in all and by part, and the worker (empty without workers)."""

    task: Task
    files: tuple[WrittenFile, ...]
    seconds: float
    parts: dict[str, float]
    worker: str = ""


def tasks_of(job: Job) -> Iterator[Task]:
    """Yield the tasks of a job: its ground from the coarsest level on, then its plants."""
    for shard in job.world.shards():
        yield Task("ground", *shard)
    if job.plants != "none":
        yield from plant_tasks(job)


def plant_tasks(job: Job) -> Iterator[Task]:
    """Yield the tasks of a job's plants: shards of the finest level that have an area, row after row."""
    rows, columns = _plant_squares(job)
    for row in range(rows):
        for column in range(columns):
            yield Task("plants", 0, row, column)


def task_count(job: Job) -> int:
    """Return the number of tasks of a job."""
    rows, columns = _plant_squares(job)
    return job.world.shard_count + (rows * columns if job.plants != "none" else 0)


def _plant_squares(job: Job) -> tuple[int, int]:
    level = job.world.levels[0]
    return -(-(level.rows - 1) // SHARD), -(-(level.columns - 1) // SHARD)
