"""Where a world's plants are written: squares of the ground, a file each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sketchterrain.export.files import prepare_folder
from sketchterrain.export.placed_layers import Origin
from sketchterrain.whole_files import telling_failure
from sketchterrain.world.grid import SHARD
from sketchterrain.world.libraries import require
from sketchterrain.world.made import Task
from sketchterrain.world.plants_files import write_flatgeobuf, write_parquet
from sketchterrain.world.plants_table import batches_of
from sketchterrain.world.roots import plants_folder
from sketchterrain.world.tiff_layers import Georeference

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.terrain import Terrain
    from sketchterrain.world.grid import World
    from sketchterrain.world.job import Job

__all__ = ["PLANT_LIBRARIES", "PlantStore", "plant_square", "plant_tasks"]

PLANT_LIBRARIES: Final = {
    "parquet": ("pyarrow",),
    "flatgeobuf": ("pyarrow",),
}
"""What each form of plants is written by."""


def plant_square(world: World, row: int, column: int) -> tuple[float, float, float, float]:
    """Return the rectangle whose plants a shard of the finest level has: west, south, east, north, m.

    West and south are in it, east and north are not: they are the west and the south of its neighbours, to
    the bit. The easternmost and southernmost shards end at their last vertices; one of a single column or
    row has no area.
    """
    level = world.levels[0]

    def edge(number: int, vertices: int) -> float:
        return min(number * SHARD, vertices - 1) * level.cell

    return (
        world.west + edge(column, level.columns),
        world.north - edge(row + 1, level.rows),
        world.west + edge(column + 1, level.columns),
        world.north - edge(row, level.rows),
    )


def plant_tasks(job: Job) -> Iterator[Task]:
    """Return the tasks of a job's plants: shards of the finest level that have an area, row after row."""
    level = job.world.levels[0]
    for row in range(-(-(level.rows - 1) // SHARD)):
        for column in range(-(-(level.columns - 1) // SHARD)):
            yield Task("plants", 0, row, column)


class PlantStore:
    """Plants of a job, as :class:`~sketchterrain.world.forms.Plants` says.

    Parquet is a data set in partitions, ``tile_row=3/tile_column=12/plants.parquet``; FlatGeobuf is a file a
    square, ``r0003_c0012.fgb``. A square where nothing grows has a file too, without rows: so it is known
    that nothing is missing. They lie beside the world: ``world-plants`` beside ``world.zarr``.

    Parameters
    ----------
    job

    Raises
    ------
    SketchterrainError
        If a library is missing.
    """

    def __init__(self, job: Job) -> None:
        require(f"plants as {job.plants}", PLANT_LIBRARIES.get(job.plants, ()))
        self.folder = plants_folder(job.output)
        self._job = job

    def create(self) -> tuple[str, ...]:
        """Make the folder; see `Plants.create`. There is nothing in it that belongs to no square."""
        prepare_folder(self.folder)
        return ()

    def write(self, task: Task, terrain: Terrain) -> tuple[str, ...]:
        """Write the plants of a square; see `Plants.write`.

        They are found and written in pieces: more of them take time, not memory, but for an index of
        FlatGeobuf.

        Raises
        ------
        SketchterrainError
            If the system cannot write it.
        """
        name = self._name(task)
        path = self.folder / name
        with telling_failure(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        rows = batches_of(self._plants(task, terrain), terrain.species_names, Origin(*self._job.origin))
        crs = Georeference(self._job).crs
        if self._job.plants == "parquet":
            write_parquet(path, rows, crs)
        else:
            write_flatgeobuf(path, rows, crs)
        return (name,)

    def _name(self, task: Task) -> str:
        if self._job.plants == "parquet":
            return f"tile_row={task.row}/tile_column={task.column}/plants.parquet"
        return f"r{task.row:04d}_c{task.column:04d}.fgb"

    def _plants(self, task: Task, terrain: Terrain) -> Iterator[npt.NDArray[np.void]]:
        square = plant_square(self._job.world, task.row, task.column)
        for storey in ("woody", "grass") if self._job.grass else ("woody",):
            yield from terrain.foliage_pieces(*square, storey=storey)
