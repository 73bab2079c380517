"""All tasks of a job, one by one: a world of any size has no list of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.world.made import Task

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sketchterrain.world.job import Job

__all__ = ["task_count", "tasks_of"]


def tasks_of(job: Job) -> Iterator[Task]:
    """Return the tasks of a job: its ground from the coarsest level on, then its plants."""
    for shard in job.world.shards():
        yield Task("ground", *shard)
    if job.plants != "none":
        from sketchterrain.world.plants_store import plant_tasks

        yield from plant_tasks(job)


def task_count(job: Job) -> int:
    """Return how many tasks a job has."""
    if job.plants == "none":
        return job.world.shard_count
    return sum(1 for _ in tasks_of(job))
