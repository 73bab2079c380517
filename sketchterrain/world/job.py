"""Jobs of written worlds: fingerprint, tasks, stores, georeference."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cached_property
from importlib.metadata import version
from importlib.util import find_spec
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
from sketchterrain.errors import SketchterrainError
from sketchterrain.export.rasters import local_metres
from sketchterrain.generation.stages import fingerprint
from sketchterrain.io.crs import parse_metric_crs
from sketchterrain.io.files import hash_file, wrap_os_errors, wrap_read_errors, write_atomic
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.world.grid import SHARD, GridLevel, LayerSpec, Shard, World, layer_specs

Form = Literal["zarr", "tiles", "tif"]
"""A Zarr store; a folder of GeoTIFF tiles with VRTs; one GeoTIFF per layer."""
ENDINGS: Final[dict[str, str]] = {"zarr": ".zarr", "tiles": "", "tif": ".tif"}
"""File name extension of each form."""
PlantsForm = Literal["none", "parquet", "flatgeobuf"]
_LIBRARIES: Final = {
    "zarr": ("zarr", "numcodecs"),
    "tiles": ("rasterio",),
    "tif": ("rasterio",),
    "none": (),
    "parquet": ("pyarrow",),
    "flatgeobuf": ("pyogrio",),
}
"""Libraries whose versions may change the encoding of files, but no value in them."""
_NOT_IN_BYTES: Final = ("sketch", "recipe", "output")  # the recipe is the sketch's


@dataclass(frozen=True, eq=False)
class Job:
    """A world to write: `output` is absolute, `crs` None means local metres with the sketch at `origin`.

    `recipe` is placed once, not by each worker. Heights are rounded to multiples of `step` (m; 0: exact).
    `fast` trades bit-reproducibility for speed.
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

    @property
    def layout(self) -> OutputLayout:
        """The paths of the world's files."""
        return OutputLayout.of(self.output, self.form)

    @property
    def specs(self) -> dict[str, LayerSpec]:
        """The layers that the world may have."""
        return layer_specs(self.recipe.materials.names)


def job_fingerprint(job: Job) -> str:
    """Return a digest of everything that determines a world's bytes: neither output path nor device."""
    options = [getattr(job, each.name) for each in fields(job) if each.name not in _NOT_IN_BYTES]
    libraries = [(name, version(name)) for name in (*_LIBRARIES[job.form], *_LIBRARIES[job.plants])]
    return fingerprint(job.sketch, options, libraries)


class Task(NamedTuple):
    """One file of each layer (``ground``) or of plants, for a shard; plants have level 0. Independent."""

    kind: Literal["ground", "plants"]
    level: int
    row: int
    column: int


class WrittenFile(NamedTuple):
    """A file's relative name with ``/``, its length and SHA-256."""

    file: str
    bytes: int
    sha256: str

    @classmethod
    def from_path(cls, path: Path, name: str) -> WrittenFile:
        """Hash a file; raise OSError if it cannot be read."""
        return cls(name, *hash_file(path))


@dataclass(frozen=True)
class TaskResult:
    """A finished task: its files, and the worker's name (empty without workers)."""

    task: Task
    files: tuple[WrittenFile, ...]
    worker: str = ""


def iter_tasks(job: Job) -> Iterator[Task]:
    """Yield the tasks of a job: shards from the coarsest level on, then plants."""
    for shard in job.world.shards():
        yield Task("ground", *shard)
    yield from plant_tasks(job)


def plant_tasks(job: Job) -> Iterator[Task]:
    """Yield the plant tasks of a job: shards of the finest level that have an area, row by row."""
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


SKETCH: Final = "sketch.sketch"
"""The sketch of a world of GeoTIFF tiles."""
LEDGER: Final = "ledger.jsonl"
"""All other files of a finished world, with their hashes."""
JOURNAL: Final = "journal.jsonl"
"""The same while the world is being written, for every form."""
PLANTS: Final = "plants/"
"""Prefix of the names of plant files in the ledger."""
TAGS: Final = "sketchterrain"
"""GDAL metadata domain of the world's description."""


def require(what: str, modules: Iterable[str]) -> None:
    """Raise SketchterrainError if a module of the extra ``world`` is not usable; import none."""
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        raise SketchterrainError(
            f"{what} needs {' and '.join(missing)}: not installed, "
            "get it with pip install 'sketchterrain[world]'"
        )
    if not __debug__ and "zarr" in modules:  # zarr 3.1 then does not read what it wrote
        raise SketchterrainError(f"{what} needs Python's assertions: run it without -O and PYTHONOPTIMIZE")


def check_libraries(job: Job) -> None:
    """Raise SketchterrainError if a library of a job's form or plants is missing."""
    if job.form == "zarr":
        require("A world as a Zarr store", ["zarr"])
    if job.plants != "none":
        require(f"plants as {job.plants}", ["pyarrow"])


@dataclass(frozen=True)
class OutputLayout:
    """Paths of a world: the folder of its files' names, its journal, its ledger, and the folder of plants."""

    folder: Path
    journal: Path
    ledger: Path
    plants: Path

    @classmethod
    def of(cls, output: Path, form: Form) -> OutputLayout:
        """Return the paths of a world of some form."""
        plants = output.with_name(f"{output.stem if output.suffix else output.name}-plants")
        if form == "zarr":  # readers of Zarr ignore further files in an array's folder
            return cls(output, output / "ledger" / JOURNAL, output / "ledger" / "c" / "0", plants)
        if form == "tiles":
            return cls(output, output / JOURNAL, output / LEDGER, plants)
        ledger = output.with_name(f"{output.stem}.{LEDGER}")
        return cls(output.parent, output.with_name(f".{output.name}.parts") / JOURNAL, ledger, plants)

    def path(self, name: str) -> Path:
        """Return the path of a file of the ledger."""
        if name.startswith(PLANTS):
            return self.plants / name.removeprefix(PLANTS)
        return self.folder / name


def tile_name(layer: str, shard: Shard) -> str:
    """Return the relative name of a shard's GeoTIFF."""
    return f"{layer}/level{shard.level}/r{shard.row:04d}_c{shard.column:04d}.tif"


def vrt_name(layer: str, level: int) -> str:
    """Return the relative name of the VRT that joins the tiles of a level."""
    return f"{layer}/level{level}.vrt" if level else f"{layer}.vrt"


def layer_file(world: Path, layer: str) -> Path:
    """Return the GeoTIFF of a layer; heights have the world's own name."""
    return world if layer == "height" else world.with_name(f"{world.stem}_{layer}{world.suffix}")


def write_if_changed(path: Path, content: bytes) -> None:
    """Write a file atomically, creating its folder, unless it already has this content."""
    with wrap_os_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        same = path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content
    if not same:
        write_atomic(path, content)


def read_text(path: Path) -> str | None:
    """Return the text of a file, None if it is missing."""
    with wrap_read_errors(path), suppress(FileNotFoundError, NotADirectoryError):
        return path.read_bytes().decode(errors="replace")
    return None


GRID_MAPPING: Final = "spatial_ref"
"""Array of each level that holds the coordinate reference system."""

_CONVENTIONS: Final = {  # identifier and description
    "multiscales": "d35379db-88df-4056-af3a-620245f8e347 Multiscale layout of zarr datasets",
    "proj": "f17cb550-5864-4468-aeb7-f3180cfb622f "
    "Coordinate reference system information for geospatial data",
    "spatial": "689b58e2-cf7b-45e0-9fff-9cfc0883d6b4 Spatial coordinate information",
}
_CODE = re.compile(r"[A-Z]+:[0-9]+")  # valid values of ``proj:code``


@dataclass(frozen=True, eq=False)
class WorldFrame:
    """Coordinates of the vertices of a job's levels."""

    job: Job

    @cached_property
    def crs(self) -> CRS:
        """The coordinate reference system of the job, or local metres without a place on Earth."""
        return local_metres() if self.job.crs is None else parse_metric_crs(self.job.crs)

    def transform(self, level: GridLevel, shard: Shard | None = None) -> Affine:
        """Return the affine transform of a level or shard, half a cell north-west of the first vertex."""
        row, column = (0, 0) if shard is None else (shard.row * SHARD, shard.column * SHARD)
        (east, north), world, cell = self.job.origin, self.job.world, level.cell
        west = east + world.west + (column - 0.5) * cell
        return Affine(cell, 0.0, west, 0.0, -cell, north + world.north - (row - 0.5) * cell)

    def coordinates(self, axis: str, level: GridLevel) -> npt.NDArray[np.float64]:
        """Return the coordinates of columns (``x``, eastward) or rows (``y``, southward)."""
        (east, north), world = self.job.origin, self.job.world
        steps = np.arange(level.columns if axis == "x" else level.rows, dtype=np.float64) * level.cell
        return east + (world.west + steps) if axis == "x" else north + (world.north - steps)

    def root_attributes(self) -> dict[str, Any]:
        """Return the attributes of the root group, with the pyramid."""
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

    def group_attributes(self, level: GridLevel) -> dict[str, Any]:
        """Return the attributes of a level's group."""
        return {
            "cell": level.cell,
            "zarr_conventions": _conventions("proj", "spatial"),
            "spatial:dimensions": ["y", "x"],
            "spatial:bbox": self._bounds(level),
            **self._grid(level),
            **self._projection,
        }

    def mapping_attributes(self, level: GridLevel) -> dict[str, Any]:
        """Return the attributes of a level's array `GRID_MAPPING`."""
        wkt = self.crs.to_wkt()
        gdal = " ".join(map(repr, self.transform(level).to_gdal()))
        return {"crs_wkt": wkt, "spatial_ref": wkt, "GeoTransform": gdal}

    def _grid(self, level: GridLevel) -> dict[str, Any]:
        transform = list(self.transform(level))[:6]
        return {"spatial:shape": [level.rows, level.columns], "spatial:transform": transform}

    def _bounds(self, level: GridLevel) -> list[float]:
        cell, _, west, _, _, north = list(self.transform(level))[:6]
        return [west, north - level.rows * cell, west + level.columns * cell, north]

    @cached_property
    def _projection(self) -> dict[str, Any]:
        code = ":".join(self.crs.to_authority() or ())
        # The convention requires exactly one of them.
        if _CODE.fullmatch(code):
            return {"proj:code": code}
        return {"proj:wkt2": self.crs.to_wkt(version=WktVersion.WKT2_2019)}


def axis_attributes(name: str) -> dict[str, Any]:
    """Return the attributes of the coordinates along ``x`` or ``y``."""
    long_name = {"x": "easting", "y": "northing"}[name] + " of the vertices"
    standard_name = f"projection_{name}_coordinate"
    return {"standard_name": standard_name, "long_name": long_name, "units": "m", "axis": name.upper()}


def _conventions(*names: str) -> list[dict[str, str]]:
    """Return the declaration of conventions that attributes follow, as specified on GitHub."""
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
