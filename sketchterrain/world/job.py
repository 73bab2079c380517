"""What a world consists of: job, fingerprint and georeference."""

import json
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from hashlib import sha256
from importlib.metadata import version
from importlib.resources import files
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from rasterio import Affine
from rasterio.crs import CRS
from rasterio.enums import WktVersion

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.toml_format import settings_text
from sketchterrain.export.rasters import local_metres
from sketchterrain.io.crs import parse_metric_crs
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.world.grid import SHARD, Level, Shard, World

Form = Literal["zarr", "tiles", "tif"]
"""A Zarr store; a folder of GeoTIFF tiles with VRTs; one GeoTIFF a layer."""
ENDINGS: Final[dict[str, str]] = {"zarr": ".zarr", "tiles": "", "tif": ".tif"}
"""Of an output's name."""
PlantsForm = Literal["none", "parquet", "flatgeobuf"]
_ROOMS: Final = (
    "document",
    "placement",
    "hydrology",
    "compute",
    "terrain",
    "vegetation",
    "export",
    "world",
    "kernels",
)
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
    from sketchterrain.batch.results import image_digest  # it loads OpenCL

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


GRID_MAPPING: Final = "spatial_ref"
"""The array of each level that carries the coordinate reference system."""

_CONVENTIONS: Final = {  # identifier and description
    "multiscales": "d35379db-88df-4056-af3a-620245f8e347 Multiscale layout of zarr datasets",
    "proj": "f17cb550-5864-4468-aeb7-f3180cfb622f "
    "Coordinate reference system information for geospatial data",
    "spatial": "689b58e2-cf7b-45e0-9fff-9cfc0883d6b4 Spatial coordinate information",
}
_CODE = re.compile(r"[A-Z]+:[0-9]+")  # what ``proj:code`` may hold


@dataclass(frozen=True, eq=False)
class Georeference:
    """Where the vertices of a job's levels lie."""

    job: Job

    @cached_property
    def crs(self) -> CRS:
        """The job's coordinate reference system, or local metres that lie nowhere on Earth."""
        return local_metres() if self.job.crs is None else parse_metric_crs(self.job.crs)

    def transform(self, level: Level, shard: Shard | None = None) -> Affine:
        """Return the transform of a level or of one of its shards.

        Pixels are centred at vertices, and a transform maps corners of pixels: it begins half a cell
        north-west of the first vertex.
        """
        row, column = (0, 0) if shard is None else (shard.row * SHARD, shard.column * SHARD)
        (east, north), world, cell = self.job.origin, self.job.world, level.cell
        west = east + world.west + (column - 0.5) * cell
        return Affine(cell, 0.0, west, 0.0, -cell, north + world.north - (row - 0.5) * cell)

    def coordinates(self, axis: str, level: Level) -> npt.NDArray[np.float64]:
        """Return coordinates of columns along ``x``, eastward, or of rows along ``y``, southward."""
        (east, north), world = self.job.origin, self.job.world
        steps = np.arange(level.columns if axis == "x" else level.rows, dtype=np.float64) * level.cell
        return east + (world.west + steps) if axis == "x" else north + (world.north - steps)

    def root_attributes(self) -> dict[str, Any]:
        """Return the attributes of the root group: the pyramid."""
        levels = self.job.world.levels
        layout = [{"asset": "0", "transform": {"scale": [1.0, 1.0]}} | self._grid(levels[0])]
        for level in levels[1:]:
            source = {"asset": str(level.number), "derived_from": str(level.number - 1)}
            layout.append(source | {"transform": {"scale": [2.0, 2.0]}} | self._grid(level))
        return {
            "zarr_conventions": _conventions("multiscales", "proj", "spatial"),
            "multiscales": {"layout": layout},
            "spatial:dimensions": ["y", "x"],
            "spatial:bbox": self._bounds(levels[0]),
            **self._projection,
        }

    def group_attributes(self, level: Level) -> dict[str, Any]:
        """Return the attributes of a level's group."""
        return {
            "cell": level.cell,
            "zarr_conventions": _conventions("proj", "spatial"),
            "spatial:dimensions": ["y", "x"],
            "spatial:bbox": self._bounds(level),
            **self._grid(level),
            **self._projection,
        }

    def mapping_attributes(self, level: Level) -> dict[str, Any]:
        """Return the attributes of a level's array `GRID_MAPPING`."""
        wkt = self.crs.to_wkt()
        gdal = " ".join(map(repr, self.transform(level).to_gdal()))
        return {"crs_wkt": wkt, "spatial_ref": wkt, "GeoTransform": gdal}

    def _grid(self, level: Level) -> dict[str, Any]:
        transform = list(self.transform(level))[:6]
        return {"spatial:shape": [level.rows, level.columns], "spatial:transform": transform}

    def _bounds(self, level: Level) -> list[float]:
        cell, _, west, _, _, north = list(self.transform(level))[:6]
        return [west, north - level.rows * cell, west + level.columns * cell, north]

    @cached_property
    def _projection(self) -> dict[str, Any]:
        code = ":".join(self.crs.to_authority() or ())
        # The convention wants exactly one of them.
        if _CODE.fullmatch(code):
            return {"proj:code": code}
        return {"proj:wkt2": self.crs.to_wkt(version=WktVersion.WKT2_2019)}


def axis_attributes(name: str) -> dict[str, Any]:
    """Return the attributes of the coordinates along ``x`` or ``y``."""
    long_name = {"x": "easting", "y": "northing"}[name] + " of the vertices"
    standard_name = f"projection_{name}_coordinate"
    return {"standard_name": standard_name, "long_name": long_name, "units": "m", "axis": name.upper()}


def _conventions(*names: str) -> list[dict[str, str]]:
    """Return the declaration that attributes follow conventions, as their pages on GitHub ask for it."""
    raw, pages = "https://raw.githubusercontent.com/zarr-conventions", "https://github.com/zarr-conventions"
    return [
        {
            "schema_url": f"{raw}/{name}/refs/tags/v0.1/schema.json",
            "spec_url": f"{pages}/{name}/blob/v0.1/README.md",
            "uuid": _CONVENTIONS[name].partition(" ")[0],
            "name": name,
            "description": _CONVENTIONS[name].partition(" ")[2],
        }
        for name in names
    ]
