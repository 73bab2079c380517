"""The job of writing a world: what its bytes follow from, its fingerprint, and the tasks it consists of."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from importlib.resources import files
from itertools import product
from math import prod
from pathlib import Path
from typing import Final, Literal, NamedTuple

from sketchterrain.sketch import Sketch
from sketchterrain.sketch.toml_text import settings_text
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.world.grid import SHARD, World

Form = Literal["zarr", "tiles", "tif"]
"""A Zarr store; a folder of GeoTIFF tiles with VRTs; one GeoTIFF a layer."""
ENDINGS: Final[dict[str, str]] = {"zarr": ".zarr", "tiles": "", "tif": ".tif"}
"""Of an output's name."""
PlantsForm = Literal["none", "parquet", "flatgeobuf"]
_ROOMS: Final = ("sketch", "features", "compute", "terrain", "export", "world", "kernels")
_SOURCES: Final = (".py", ".cl", ".clh")
_PACKERS: Final = {
    "zarr": ("zarr", "numcodecs"),
    "tiles": ("rasterio",),
    "tif": ("rasterio",),
    "none": (),
    "parquet": ("pyarrow",),
    "flatgeobuf": ("pyogrio",),
}
"""Libraries whose versions may change bytes of files, but no value in them."""


@dataclass(frozen=True, eq=False)
class Job:
    """A world that is to be written.

    `sketch` has the seed that counts, and `recipe` is placed once, not by each worker. `output` is absolute.
    `crs` None means metres from the sketch's south-west corner, which lies at `origin` in it. Heights are
    rounded to multiples of `step`, a power of two in m; 0 keeps every bit. With `fast`, kernels trade bits
    for speed.
    """

    sketch: Sketch
    recipe: TerrainRecipe
    world: World
    output: Path
    form: Form
    layers: tuple[str, ...]
    plants: PlantsForm = "none"
    grass: bool = False
    crs: str | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    step: float = 0.0
    fast: bool = False


def fingerprint(job: Job) -> str:
    """Return the SHA-256 of all that a world's bytes follow from: not the output's path, nor the device."""
    from sketchterrain.batch.output import image_digest  # it loads OpenCL

    whole = {
        "version": version("sketchterrain"),
        "code": code_digest(),
        "settings": settings_text(job.sketch),
        "painted": {name: image_digest(image) for name, image in job.sketch.layers.items()},
        "world": asdict(job.world),
        "layers": sorted(job.layers),
        **{name: getattr(job, name) for name in ("form", "plants", "grass", "crs", "origin", "step", "fast")},
        "libraries": {name: version(name) for name in (*_PACKERS[job.form], *_PACKERS[job.plants])},
    }
    return sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


@cache
def code_digest() -> str:
    """Return the SHA-256 of the code and the kernels that a world's bytes follow from."""
    digest = sha256()
    for room in _ROOMS:
        for each in sorted(files(f"sketchterrain.{room}").iterdir(), key=lambda found: found.name):
            if each.name.endswith(_SOURCES) and each.is_file():
                digest.update(f"{room}/{each.name}\n".encode())
                digest.update(each.read_bytes())
    return digest.hexdigest()


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
    yield from plant_tasks(job)


def plant_tasks(job: Job) -> Iterator[Task]:
    """Yield the tasks of a job's plants: shards of the finest level that have an area, row after row."""
    for row, column in product(*map(range, _plant_squares(job))):
        yield Task("plants", 0, row, column)


def task_count(job: Job) -> int:
    """Return the number of tasks of a job."""
    return job.world.shard_count + prod(_plant_squares(job))


def _plant_squares(job: Job) -> tuple[int, int]:
    if job.plants == "none":
        return 0, 0
    level = job.world.levels[0]
    return -(-(level.rows - 1) // SHARD), -(-(level.columns - 1) // SHARD)
