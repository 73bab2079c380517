"""Options of a world to write, and estimates of its memory and disk space."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, get_args

from sketchterrain.document.frame import georeference
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, one_line, prefix_errors
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.io.console import pluralize
from sketchterrain.jobs.estimates import Estimate, format_count, layer_bytes, plant_bytes
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.world.grid import DEFAULT_LAYERS, LAYERS, Shard, World
from sketchterrain.world.job import Form, Job, PlantsForm, require, task_count
from sketchterrain.world.journal import load_ledger

_FINEST_STEP, _COARSEST_STEP = 2.0**-24, 2.0**10  # m
# Bytes, measured with all layers: a process with an open device, kernel buffers of up to _LAUNCHED vertices,
# and two shards, one being evaluated and one being written.
_PROCESS: Final = 280 << 20
_LAUNCHED: Final = 1 << 20
_BYTES_LAUNCHED: Final = 92
_BYTES_PER_VERTEX: Final = 56


@dataclass(frozen=True)
class WorldOptions:
    """Options of a world, see `Job`; `workers` is whether worker processes run the tasks.

    `bounds` are west, south, east, north (m), None for the sketch's rectangle.
    """

    bounds: tuple[float, float, float, float] | None = None
    cell: float = 1.0
    layers: tuple[str, ...] = DEFAULT_LAYERS
    plants: PlantsForm = "none"
    grass: bool = False
    crs: str | None = None  # None: the sketch's, as the origin
    origin: tuple[float, float] | None = None
    step: float = 0.0
    fast: bool = False
    workers: bool = False

    def check(self, sketch: Sketch) -> World:
        """Return the sampling grid; raise InputError for invalid options."""
        world = World(*(self.bounds or (0.0, 0.0, *sketch.size)), self.cell)
        _check_lattice(world, sketch.extent)
        if self.plants not in get_args(PlantsForm):
            raise InputError(f"expected plants as none, parquet or flatgeobuf, got {one_line(self.plants)!r}")
        if self.grass and self.plants == "none":
            raise InputError("grass without plants: expected plants as parquet or flatgeobuf with it")
        power = _FINEST_STEP <= self.step <= _COARSEST_STEP and math.frexp(self.step)[0] == 0.5
        if self.step != 0 and not power:
            raise InputError(
                f"step {self.step:g}: expected a power of two of metres up to {_COARSEST_STEP:g}, "
                "as 0.0078125, or 0 for every bit"
            )
        if not all(math.isfinite(number) for number in self.origin or ()):
            raise InputError(f"expected a finite origin, got {self.origin}")
        if self.crs is not None:
            from sketchterrain.io.crs import parse_metric_crs

            parse_metric_crs(self.crs)
        check_layers(self.layers)
        if self.workers:
            require("a world by workers", ["distributed"])
        return world

    def job(self, sketch: Sketch, recipe: TerrainRecipe, output: Path, form: Form) -> Job:
        """Return the job of writing a sketch's world to an output; raise InputError as `check`."""
        own = {name: getattr(self, name) for name in ("plants", "grass", "step", "fast")}
        own["crs"], own["origin"] = georeference(sketch.frame, self.crs, self.origin)
        layers = check_layers(self.layers)
        return Job(sketch, recipe, self.check(sketch), output.absolute(), form, layers, **own)


def output_form(output: str) -> Form:
    """Return the form of an output by its extension; a folder has none, a trailing slash, or exists."""
    if not output.strip():
        raise InputError("expected a path to write to, got none")
    ending = Path(output).suffix.lower()
    if ending == ".zarr":
        return "zarr"
    output.encode()  # raises for a name that GDAL refuses, later
    if ending in (".tif", ".tiff"):
        return "tif"
    if ending and not output.endswith("/") and not Path(output).is_dir():
        raise InputError(
            f"{one_line(output)}: expected a name that ends in .zarr or .tif, or a folder's without an ending"
        )
    return "tiles"


def check_layers(names: Sequence[str]) -> tuple[str, ...]:
    """Return layers in their standard order; raise InputError for an unknown one, or without heights."""
    text = ",".join(names)
    unknown = next((name for name in names if name not in LAYERS), None)
    if unknown is not None:
        raise InputError(f"layers {one_line(text)!r}: expected some of {', '.join(LAYERS)}")
    if "height" not in names:
        raise InputError(f"layers {one_line(text)!r}: expected height among them")
    return tuple(name for name in LAYERS if name in names)


def _check_lattice(world: World, extent: float) -> None:
    """Refuse a cell size or bounds that the integer lattice of positions cannot represent."""
    unit = metres_per_unit(extent)
    if world.cell < unit:
        raise InputError(
            f"cell {world.cell:g} m: expected at least {unit:.3g} m, the finest for a sketch of {extent:g} m"
        )
    for level in world.levels:
        east = world.west + (level.columns + 1) * level.cell
        south = world.north - (level.rows + 1) * level.cell
        bounds = f"{world.west:g},{world.south:g},{world.east:g},{world.north:g}"
        with prefix_errors(f"bounds {bounds}"):
            to_lattice([world.west - level.cell, east, world.north + level.cell, south], extent)


@dataclass(frozen=True)
class WorldEstimate:
    """Memory and disk space of a world, and the number of its finished tasks."""

    job: Job
    needs: Estimate
    tasks: int
    done: int

    def check_resources(self) -> None:
        """Raise InputError if disk space or memory is insufficient."""
        self.needs.check(self.job.output, "the world's files")

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate as JSON data."""
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
        """Return the estimate as lines of text."""
        world, finest = self.job.world, self.job.world.levels[0]
        done = f", {self.done} of them done" if self.done else ""
        return [
            f"world: {finest.columns} × {finest.rows} vertices {world.cell:g} m apart, "
            f"{pluralize(len(world.levels), 'level')}, {format_count(world.vertices)} vertices in all, "
            f"{pluralize(self.tasks, 'shard')}{done}",
            *self.needs.lines(self.job.output),
        ]


def estimate_world(job: Job, *, workers: int = 0) -> WorldEstimate:
    """Return the needs of a job with `workers` local processes (0: this one)."""
    world = job.world
    disk = layer_bytes(world.vertices, job.layers)
    if job.step:
        disk["height"] *= 0.4
    if job.form == "tif":
        disk["temporary"] = sum(disk.values())  # shards until they are joined
    if job.plants != "none":
        east, north = job.sketch.size  # plants are limited to the sketch
        across = max(min(world.east, east) - max(world.west, 0.0), 0.0)
        down = max(min(world.north, north) - max(world.south, 0.0), 0.0)
        disk["plants"] = plant_bytes(across * down, job.plants, grass=job.grass)
    vertices = max(math.prod(level.size_of(Shard(level.number, 0, 0))) for level in world.levels)
    each = _PROCESS + _BYTES_LAUNCHED * min(vertices, _LAUNCHED) + _BYTES_PER_VERTEX * vertices
    memory = each * max(workers, 1) + (_PROCESS if workers else 0)
    ledger = load_ledger(job)
    done, present = (0, 0) if ledger is None else (len(ledger.done), ledger.bytes)
    return WorldEstimate(job, Estimate(disk, memory, present), task_count(job), done)
