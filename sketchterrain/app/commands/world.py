"""Commands `world`, `stats` and `view`, for worlds larger than memory."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sketchterrain.app import arguments as args
from sketchterrain.app.listings import legend_lines, print_json, print_lines, print_result
from sketchterrain.app.option_groups import with_option_groups
from sketchterrain.io.console import PARTIAL, USAGE_ERROR, Stages, fail, pluralize, print_note
from sketchterrain.io.files import format_bytes
from sketchterrain.io.system import restore_default_sigterm
from sketchterrain.jobs.estimates import format_count, format_duration

if TYPE_CHECKING:
    from sketchterrain.world.journal import BrokenFile
    from sketchterrain.world.options import WorldEstimate
    from sketchterrain.world.run import WorldResult
    from sketchterrain.world.statistics import Statistics

_MAX_WORKERS = 1024
_MAX_FILES = 10  # missing or broken ones named in text
_BAR_LENGTH = 40  # characters
_WIDTH = 12  # columns

_LAYERS = "Some of height,normal,materials,appearance."


def world(
    sketch: args.SketchName,
    output: Annotated[
        str,
        typer.Option(
            "--output",
            "-o",
            metavar="PATH",
            help="world.zarr: a Zarr store; world.tif: a GeoTIFF a layer; DIR: a folder of GeoTIFF tiles.",
        ),
    ],
    bounds: args.WorldBounds = None,
    cell: Annotated[float, typer.Option(metavar="M", help="Metres between vertices.")] = 1.0,
    layers: Annotated[str, typer.Option(metavar="NAMES", help=_LAYERS)] = "height,normal,materials",
    plants: Annotated[
        str, typer.Option(metavar="none|parquet|flatgeobuf", help="File format of plants.")
    ] = "none",
    grass: args.Grass = False,
    crs: args.Crs = None,
    origin: args.Origin = None,
    step: Annotated[
        float,
        typer.Option(metavar="M", help="Round heights to a power of two, as 0.0078125; 0: exact."),
    ] = 0.0,
    layer: args.LayerFiles = None,
    seed: args.Seed = None,
    resume: args.Resume = False,
    dry_run: args.DryRun = False,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=_MAX_WORKERS, help="Local worker processes."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Address of a dask scheduler, as tcp://10.0.0.1:8786."),
    ] = None,
    device: args.DeviceName = None,
    fast: args.Fast = False,
    as_json: args.AsJson = False,
) -> None:
    """Write a world of any size: heights, normals, materials and plants, with coarser levels."""
    if workers is not None and scheduler is not None:
        raise USAGE_ERROR("--workers with --scheduler: either this machine's processes, or a cluster's")
    if fast and (workers is not None or scheduler is not None):
        raise USAGE_ERROR("--fast with workers: each would compute other bits")
    with Stages() as stages:
        document = args.read_sketch(sketch, seed, stages, layer)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.compute.device import choose_device
            from sketchterrain.generation.building import make_recipe, stored_results
            from sketchterrain.world.journal import check_output_unused
            from sketchterrain.world.options import WorldOptions, check_layers, estimate_world, output_form

            form = output_form(output)
            options = WorldOptions(
                bounds=bounds,
                cell=cell,
                layers=check_layers([name.strip() for name in layers.split(",")]),
                plants=plants,  # type: ignore[arg-type]
                grass=grass,
                crs=crs,
                origin=origin,
                step=step,
                fast=fast,
                workers=workers is not None or scheduler is not None,
            )
            options.check(document)
            choose_device(device)
            if scheduler is not None:
                from sketchterrain.world.cluster import check_scheduler

                check_scheduler(scheduler)
        with stages.stage("features", "Placing features") as progress:
            recipe = make_recipe(document, memory=stored_results(), progress=progress)
            job = options.job(document, recipe, Path(output), form)
        check_output_unused(job, resume=resume)
        estimate = estimate_world(job, workers=workers or 0)
    if dry_run:
        print_result(estimate.as_dict(), estimate.lines(), as_json=as_json)
        estimate.check_resources()
        return
    sys.stderr.writelines(f"{line}\n" for line in estimate.lines())
    estimate.check_resources()
    from sketchterrain.world.run import ProgressReporter, run_world

    with ProgressReporter() as reporter:
        result = run_world(
            job, device=device, workers=workers, scheduler=scheduler, resume=resume, reporter=reporter
        )
    _report(result, estimate, as_json=as_json)


def _report(result: WorldResult, estimate: WorldEstimate, *, as_json: bool) -> None:
    from sketchterrain.io.system import peak_memory

    if as_json:
        print_json(
            {
                "output": str(estimate.job.output),
                "tasks": result.tasks,
                "made": result.computed,
                "broken": [{"file": file.file, "why": file.reason} for file in result.broken],
                "files": result.files,
                "bytes": result.bytes,
                "seconds": round(result.seconds, 3),
                "peak_memory": peak_memory(),
                "estimate": estimate.as_dict(),
            }
        )
        return
    world = estimate.job.world
    unchanged = f", {result.tasks - result.computed} unchanged" if result.computed < result.tasks else ""
    print_lines(
        f"{result.computed} of {pluralize(result.tasks, 'shard')} written in "
        f"{format_duration(result.seconds)}{unchanged}: {estimate.job.output}",
        f"{format_count(world.vertices)} vertices on {pluralize(len(world.levels), 'level')}, "
        f"{pluralize(result.files, 'file')}, {format_bytes(result.bytes)}",
    )


def stats(
    store: args.WorldPath,
    level: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Of the pyramid; 0, the finest.")
    ] = None,
    check: Annotated[bool, typer.Option("--check", help="Verify the hash of every file instead.")] = False,
    as_json: args.AsJson = False,
) -> None:
    """Report a written world's relief, slopes and hypsometry, or verify its files."""
    if check and level is not None:
        raise USAGE_ERROR("--level with --check: all levels are checked")
    with Stages() as stages:
        if check:
            with stages.stage("check", "Reading every file") as progress:
                from sketchterrain.world.journal import check_world

                broken = list(check_world(store, progress=progress))
        else:
            with stages.stage("open", "Opening the world"):
                from sketchterrain.landforms.placement.sea import sea_level
                from sketchterrain.world.statistics import compute_statistics
                from sketchterrain.world.stored_world import open_world

                stored = open_world(store)
                sketch = stored.sketch()
                sea = None if sketch is None else sea_level(sketch)
            with stages.stage("statistics", "Measuring") as progress:
                found = compute_statistics(stored, level=level or 0, sea_level=sea, progress=progress)
    if not check:
        print_result({"world": str(store), **found.as_dict()}, _lines(store, found), as_json=as_json)
        return
    _report_broken(store, broken, as_json=as_json)


def _report_broken(store: Path, broken: list[BrokenFile], *, as_json: bool) -> None:
    """Print missing and broken files; exit with the code for partial results if there are any."""
    from sketchterrain.errors import one_line

    if as_json:
        files = [{"file": file.file, "why": file.reason} for file in broken]
        print_json({"world": str(store), "broken": files})
    elif broken:
        print_lines(*(f"{one_line(file.file)} {file.reason}" for file in broken[:_MAX_FILES]))
        if len(broken) > _MAX_FILES:
            print_lines(f"and {len(broken) - _MAX_FILES} more")
    else:
        print_lines(f"{store}: all files are intact")
    if broken:
        count = "1 file is" if len(broken) == 1 else f"{len(broken)} files are"
        raise typer.Exit(fail(f"{count} missing or broken; `world --resume` repairs them", PARTIAL))


def _lines(store: Path, found: Statistics) -> list[str]:
    relief, slopes = found.relief, found.slopes
    lines = [
        f"{store}, level {found.level}: {found.columns} × {found.rows} vertices {found.cell:g} m apart, "
        f"{_area(found.area)}",
        f"{'relief':<{_WIDTH}}{relief.minimum:.1f} to {relief.maximum:.1f} m, range {relief.range:.1f} m; "
        f"mean {relief.mean:.1f}, standard deviation {relief.standard_deviation:.1f}",
        f"{'':<{_WIDTH}}{_quantiles(relief.quantiles, ' m')}",
    ]
    if slopes is not None:
        lines += [
            f"{'slopes':<{_WIDTH}}mean {slopes.mean:.1f}°, steepest {slopes.maximum:.1f}° ({slopes.method}); "
            f"the surface is {slopes.surface_ratio:.3f} of its map's area",
            f"{'':<{_WIDTH}}{_quantiles(slopes.quantiles, '°')}",
        ]
        step = slopes.class_width
        last = max(number for number, share in enumerate(slopes.shares) if share > 0)
        top = max(slopes.shares)
        lines += [
            _bar(f"{number * step}–{number * step + step}°", share, top)
            for number, share in enumerate(slopes.shares[: last + 1])
        ]
    hypsometry = found.hypsometry
    lines.append(f"{'hypsometry':<{_WIDTH}}integral {hypsometry.integral:.3f} (Strahler 1952); area above")
    rows = list(zip(hypsometry.heights, hypsometry.share_above, strict=True))
    lines += [_bar(f"{height:.0f} m", share, 1.0) for height, share in rows[::-2]]
    if found.sea_share is not None:
        lines.append(f"{'sea':<{_WIDTH}}{found.sea_share:.1%} of the area")
    if found.materials:
        lines.append(f"{'materials':<{_WIDTH}}share of the whole")
        ordered = sorted(found.materials.items(), key=lambda each: -each[1])
        lines += [_bar(name, share, ordered[0][1]) for name, share in ordered]
    return lines


def _bar(name: str, share: float, top: float) -> str:
    filled = round(_BAR_LENGTH * share / top) if top > 0 else 0
    return f"  {name:>{_WIDTH}}  {share:6.1%}  {'█' * filled}".rstrip()


def _quantiles(quantiles: dict[str, float], unit: str) -> str:
    return ", ".join(f"{float(share):.0%} {value:.1f}{unit}" for share, value in quantiles.items())


def _area(square_metres: float) -> str:
    return f"{square_metres / 1e6:.4g} km²" if square_metres >= 1e6 else f"{square_metres:.4g} m²"


@with_option_groups
def view(
    store: args.WorldPath,
    output: args.PictureFile = None,
    *,
    picture: args.PictureArguments,
    device: args.DeviceName = None,
) -> None:
    """View a written world in a window, or with -o render a picture of it."""
    if output is None:
        for name, value in vars(picture).items():
            if name != "layer" and value is not None and value != []:
                raise USAGE_ERROR(f"--{name.replace('_', '-')} needs -o: it is for pictures")
        from sketchterrain.ui.app import run_world

        restore_default_sigterm()
        raise typer.Exit(run_world(store, args.read_layers(picture.layer or ()), device=device))
    picture.check_camera()
    with Stages() as stages:
        with stages.stage("program", "Loading the program"):
            from sketchterrain.jobs.pictures import PictureOptions
            from sketchterrain.world.viewed import draw_world

        options = PictureOptions(**picture.given())
        drapes = args.read_layers(picture.layer or ())
        legend, missing = draw_world(store, output, options, drapes, device=device, stages=stages)
    print_note(*missing)
    print_lines(str(output), *legend_lines(legend))
