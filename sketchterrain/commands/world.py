"""The command that writes worlds larger than memory: what is asked for, what it takes, what came of it."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain import arguments as given
from sketchterrain.commands import target_arguments as asked
from sketchterrain.commands.sketches import read_sketch
from sketchterrain.exit_codes import USAGE_ERROR
from sketchterrain.listings import counted, say, say_json
from sketchterrain.progress import Stages

if TYPE_CHECKING:
    from sketchterrain.world.estimate import Estimate
    from sketchterrain.world.job import Job
    from sketchterrain.world.run import Done

__all__ = ["world"]

_MOST_WORKERS = 1024


def _bounds(text: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 4 or not all(math.isfinite(number) for number in numbers):
        raise typer.BadParameter(f"expected WEST,SOUTH,EAST,NORTH in metres, got {text!r}")
    return numbers


Output = Annotated[
    str,
    typer.Option(
        "--output",
        "-o",
        metavar="PATH",
        help="world.zarr: a Zarr store; world.tif: a GeoTIFF a layer; DIR: a folder of GeoTIFF tiles.",
    ),
]
Bounds = Annotated[
    Any,
    typer.Option(
        "--bounds", parser=_bounds, metavar="W,S,E,N", help="Metres; by default the sketch's rectangle."
    ),
]
Cell = Annotated[float, typer.Option("--cell", metavar="M", help="Metres between vertices.")]
Layers = Annotated[str, typer.Option("--layers", metavar="NAMES", help="Some of height,normal,materials.")]
PlantsKind = Annotated[
    str, typer.Option("--plants", metavar="none|parquet|flatgeobuf", help="As what plants are written.")
]
Grass = Annotated[bool, typer.Option("--grass", help="Grass, flowers and ferns among the plants: many.")]
Step = Annotated[
    float,
    typer.Option("--step", metavar="M", help="Round heights to a power of two, as 0.0078125; 0: every bit."),
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on: whole files stay, missing and broken ones are made again.")
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Tell what disk, memory and time it would take; write nothing.")
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers", metavar="N", min=1, max=_MOST_WORKERS, help="Processes of this machine that share it."
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="A dask scheduler's, as tcp://10.0.0.1:8786."),
]


def world(
    sketch: given.SketchName,
    output: Output,
    bounds: Bounds = None,
    cell: Cell = 1.0,
    layers: Layers = "height,normal,materials",
    plants: PlantsKind = "none",
    grass: Grass = False,
    crs: asked.Crs = None,
    origin: asked.Origin = None,
    step: Step = 0.0,
    seed: given.Seed = None,
    resume: Resume = False,
    dry_run: DryRun = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    device: given.DeviceName = None,
    fast: given.Fast = False,
    as_json: given.AsJson = False,
) -> None:
    """Write a world of any size: heights, normals, materials and plants, with coarser levels over them."""
    if workers is not None and scheduler is not None:
        raise USAGE_ERROR("--workers with --scheduler: either this machine's processes, or a cluster's")
    if fast and (workers is not None or scheduler is not None):
        raise USAGE_ERROR("--fast with workers: each would have bits of its own")
    with Stages() as stages:
        document = read_sketch(sketch, seed, stages)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.compute import choose_device
            from sketchterrain.terrain import make_recipe
            from sketchterrain.world.asked import Wishes, form_of, layers_of
            from sketchterrain.world.estimate import estimate
            from sketchterrain.world.roots import Roots
            from sketchterrain.world.run import refuse_taken

            form = form_of(output)
            wishes = Wishes(
                bounds=bounds,
                cell=cell,
                layers=layers_of(layers),
                plants=plants,  # type: ignore[arg-type]  # which is checked
                grass=grass,
                crs=crs,
                origin=origin or (0.0, 0.0),
                step=step,
                fast=fast,
                workers=workers is not None or scheduler is not None,
            )
            wishes.check(document)
            choose_device(device)
            if scheduler is not None:
                from sketchterrain.world.scheduler import check_scheduler

                check_scheduler(scheduler)
        with stages.stage("features", "Placing features"):
            job = wishes.job(document, make_recipe(document), Path(output), form)
        Roots.of(job)  # a library that is missing is told before any work
        refuse_taken(job, resume=resume)
        with stages.stage("samples", "Sampling the world") as tell:
            at_once = -1 if scheduler is not None else workers or 0
            told = estimate(job, device=device, workers=at_once, progress=tell)
    if dry_run:
        if as_json:
            say_json(told.as_dict())
        else:
            say(*told.lines())
        told.refuse_impossible()
        return
    sys.stderr.writelines(f"{line}\n" for line in told.lines())
    told.refuse_impossible()
    done = _written(job, told, device=device, workers=workers, scheduler=scheduler, resume=resume)
    _tell(done, told, as_json=as_json)


def _written(job: Job, told: Estimate, *, resume: bool, **crew: Any) -> Done:
    from sketchterrain.world.run import run_world
    from sketchterrain.world.telling import Telling

    with Telling(job.world, plants=told.plants is not None) as watcher:
        return run_world(job, resume=resume, watcher=watcher, **crew)


def _tell(done: Done, told: Estimate, *, as_json: bool) -> None:
    from sketchterrain.batch.remaining import duration
    from sketchterrain.disk import amount
    from sketchterrain.system import peak_memory
    from sketchterrain.world.estimate import in_words

    if as_json:
        say_json(
            {
                "output": str(told.job.output),
                "tasks": done.tasks,
                "made": done.made,
                "broken": [{"file": each.file, "why": each.why} for each in done.broken],
                "files": done.files,
                "bytes": done.bytes,
                "seconds": round(done.seconds, 3),
                "peak_memory": peak_memory(),
                "estimate": told.as_dict(),
            }
        )
        return
    world = told.job.world
    there = f", {done.tasks - done.made} were there" if done.made < done.tasks else ""
    say(
        f"{done.made} of {counted(done.tasks, 'task')} done in {duration(done.seconds)}{there}: "
        f"{told.job.output}",
        f"{in_words(world.vertices)} vertices on {counted(len(world.levels), 'level')}, "
        f"{counted(done.files, 'file')}, {amount(done.bytes)}",
    )
