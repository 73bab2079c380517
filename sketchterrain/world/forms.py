"""Which store writes which form of output."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.terrain.terrain import Terrain
    from sketchterrain.world.job import Job
    from sketchterrain.world.store import Store
    from sketchterrain.world.tasks import Task

__all__ = ["Plants", "plants_of", "store_of"]


class Plants(Protocol):
    """Where the plants of a world are written to."""

    @property
    def folder(self) -> Path:
        """The folder that names of files begin in."""
        ...

    def create(self) -> tuple[str, ...]:
        """Write all that does not depend on any plant, again without harm; return the names of its files."""
        ...

    def write(self, task: Task, terrain: Terrain) -> tuple[str, ...]:
        """Write the plants of a task, its files whole or not there, and return their names."""
        ...


def store_of(job: Job) -> Store:
    """Return where a job's ground is written to.

    Raises
    ------
    InputError
        If a library that it needs is missing.
    """
    if job.form == "zarr":
        from sketchterrain.world.zarr_store import ZarrStore

        return ZarrStore(job)
    if job.form == "tiles":
        from sketchterrain.world.geotiff_store import TileStore

        return TileStore(job)
    from sketchterrain.world.geotiff_store import TiffStore

    return TiffStore(job)


def plants_of(job: Job) -> Plants | None:
    """Return where a job's plants are written to; None where it has none.

    Raises
    ------
    InputError
        If a library that it needs is missing.
    """
    if job.plants == "none":
        return None
    from sketchterrain.world.plants import PlantStore

    return PlantStore(job)
