"""The command that writes worlds larger than memory."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain import arguments as given
from sketchterrain.commands import target_arguments as asked
from sketchterrain.commands.sketches import read_sketch
from sketchterrain.disk import format_bytes
from sketchterrain.estimate import format_count, format_duration
from sketchterrain.exit_codes import USAGE_ERROR
from sketchterrain.listings import pluralize, print_json, print_lines
from sketchterrain.progress import Stages

if TYPE_CHECKING:  # loaded once the arguments are read
    from sketchterrain.world.options import WorldEstimate
    from sketchterrain.world.run import WorldResult

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
    bool, typer.Option("--resume", help="Resume: whole files stay, missing and broken ones are made again.")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Show what disk and memory it takes; write nothing.")]
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
            from sketchterrain.world.journal import OutputLayout, check_output_unused
            from sketchterrain.world.options import WorldOptions, estimate_world, form_of, layers_of

            form = form_of(output)
            options = WorldOptions(
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
            options.check(document)
            choose_device(device)
            if scheduler is not None:
                from sketchterrain.world.cluster import check_scheduler

                check_scheduler(scheduler)
        with stages.stage("features", "Placing features"):
            job = options.job(document, make_recipe(document), Path(output), form)
        OutputLayout.of(job)  # a missing library is reported before any work
        check_output_unused(job, resume=resume)
        estimate = estimate_world(job, workers=workers or 0)
    if dry_run:
        if as_json:
            print_json(estimate.as_dict())
        else:
            print_lines(*estimate.lines())
        estimate.refuse_impossible()
        return
    sys.stderr.writelines(f"{line}\n" for line in estimate.lines())
    estimate.refuse_impossible()
    from sketchterrain.world.run import ProgressReporter, run_world

    with ProgressReporter() as watcher:
        result = run_world(
            job, device=device, workers=workers, scheduler=scheduler, resume=resume, watcher=watcher
        )
    _report(result, estimate, as_json=as_json)


def _report(result: WorldResult, estimate: WorldEstimate, *, as_json: bool) -> None:
    from sketchterrain.system import peak_memory

    if as_json:
        print_json(
            {
                "output": str(estimate.job.output),
                "tasks": result.tasks,
                "made": result.made,
                "broken": [{"file": each.file, "why": each.why} for each in result.broken],
                "files": result.files,
                "bytes": result.bytes,
                "seconds": round(result.seconds, 3),
                "peak_memory": peak_memory(),
                "estimate": estimate.as_dict(),
            }
        )
        return
    world = estimate.job.world
    there = f", {result.tasks - result.made} were there" if result.made < result.tasks else ""
    print_lines(
        f"{result.made} of {pluralize(result.tasks, 'shard')} written in "
        f"{format_duration(result.seconds)}{there}: {estimate.job.output}",
        f"{format_count(world.vertices)} vertices on {pluralize(len(world.levels), 'level')}, "
        f"{pluralize(result.files, 'file')}, {format_bytes(result.bytes)}",
    )
