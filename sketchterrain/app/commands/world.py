"""The commands ``world``, ``stats`` and ``view``."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain.app import arguments as given
from sketchterrain.app import arguments as pictured
from sketchterrain.app.arguments import AsJson, read_sketch
from sketchterrain.app.commands import target_options as asked
from sketchterrain.app.errors import PARTIAL, USAGE_ERROR, fail
from sketchterrain.app.estimates import format_count, format_duration
from sketchterrain.app.listings import legend_lines, pluralize, print_json, print_lines
from sketchterrain.app.progress import Stages
from sketchterrain.io.files import format_bytes
from sketchterrain.io.system import restore_default_sigterm

if TYPE_CHECKING:
    from sketchterrain.world.journal import Broken
    from sketchterrain.world.options import WorldEstimate
    from sketchterrain.world.run import WorldResult
    from sketchterrain.world.statistics import Statistics


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
            from sketchterrain.compute.device import choose_device
            from sketchterrain.terrain.building import make_recipe
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
    from sketchterrain.io.system import peak_memory

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


_NAMED = 10  # files that are missing or broken; --json has them all
_BAR = 40  # characters
_NAME = 12  # columns of the first word


def stats(
    store: Annotated[
        Path, typer.Argument(metavar="WORLD", help="What `world` wrote: .zarr, .tif or a folder of tiles.")
    ],
    level: Annotated[
        int | None, typer.Option("--level", metavar="N", min=0, help="Of the pyramid; 0, the finest.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Compare every file with the world's list of hashes instead.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Tell a written world's relief, slopes and hypsometry, or whether all of its files are whole."""
    if check and level is not None:
        raise USAGE_ERROR("--level with --check: all levels are checked")
    with Stages() as stages:
        if check:
            with stages.stage("check", "Reading every file") as tell:
                from sketchterrain.world.journal import check_world

                broken = list(check_world(store, progress=tell))
        else:
            with stages.stage("open", "Opening the world"):
                from sketchterrain.world.opening import open_world
                from sketchterrain.world.statistics import statistics_of

                stored = open_world(store)
            with stages.stage("statistics", "Measuring") as tell:
                found = statistics_of(stored, level=level or 0, progress=tell)
    if not check:
        if as_json:
            print_json({"world": str(store), **found.as_dict()})
        else:
            print_lines(*_lines(store, found))
        return
    _tell_checked(store, broken, as_json=as_json)


def _tell_checked(store: Path, broken: list[Broken], *, as_json: bool) -> None:
    """Tell what a check found."""
    from sketchterrain.errors import one_line

    if as_json:
        told = [{"file": each.file, "why": each.why} for each in broken]
        print_json({"world": str(store), "broken": told})
    elif broken:
        print_lines(*(f"{one_line(each.file)} {each.why}" for each in broken[:_NAMED]))
        if len(broken) > _NAMED:
            print_lines(f"and {len(broken) - _NAMED} more")
    else:
        print_lines(f"{store}: every file is as it was written")
    if broken:
        files = "1 file is" if len(broken) == 1 else f"{len(broken)} files are"
        raise typer.Exit(fail(f"{files} missing or broken; `world --resume` mends them", PARTIAL))


def _lines(store: Path, found: Statistics) -> list[str]:
    relief, slopes = found.relief, found.slopes
    lines = [
        f"{store}, level {found.level}: {found.columns} × {found.rows} vertices {found.cell:g} m apart, "
        f"{_area(found.area)}",
        f"{'relief':<{_NAME}}{relief.minimum:.1f} to {relief.maximum:.1f} m, range {relief.range:.1f} m; "
        f"mean {relief.mean:.1f}, standard deviation {relief.standard_deviation:.1f}",
        f"{'':<{_NAME}}{_quantiles(relief.quantiles, ' m')}",
    ]
    if slopes is not None:
        lines += [
            f"{'slopes':<{_NAME}}mean {slopes.mean:.1f}°, steepest {slopes.maximum:.1f}° ({slopes.method}); "
            f"the surface is {slopes.surface_ratio:.3f} of its map's area",
            f"{'':<{_NAME}}{_quantiles(slopes.quantiles, '°')}",
        ]
        step = slopes.class_width
        last = max(number for number, share in enumerate(slopes.shares) if share > 0)
        top = max(slopes.shares)
        lines += [
            _bar(f"{number * step}–{number * step + step}°", share, top)
            for number, share in enumerate(slopes.shares[: last + 1])
        ]
    hypsometry = found.hypsometry
    lines.append(f"{'hypsometry':<{_NAME}}integral {hypsometry.integral:.3f} (Strahler 1952); area above")
    rows = list(zip(hypsometry.heights, hypsometry.share_above, strict=True))
    lines += [_bar(f"{height:.0f} m", share, 1.0) for height, share in rows[::-2]]
    if found.materials:
        lines.append(f"{'materials':<{_NAME}}share of the whole")
        ordered = sorted(found.materials.items(), key=lambda each: -each[1])
        lines += [_bar(name, share, ordered[0][1]) for name, share in ordered]
    return lines


def _bar(name: str, share: float, top: float) -> str:
    filled = round(_BAR * share / top) if top > 0 else 0
    return f"  {name:>{_NAME}}  {share:6.1%}  {'█' * filled}".rstrip()


def _quantiles(quantiles: dict[str, float], unit: str) -> str:
    return ", ".join(f"{float(share):.0%} {value:.1f}{unit}" for share, value in quantiles.items())


def _area(square_metres: float) -> str:
    return f"{square_metres / 1e6:.4g} km²" if square_metres >= 1e6 else f"{square_metres:.4g} m²"


def _check_picture(path: Path | None) -> Path | None:
    if path is not None and (path.suffix.lower() != ".png" or path.is_dir()):
        raise typer.BadParameter(f"expected the name of a .png file, got {str(path)!r}")
    return path


def view(
    store: Annotated[
        Path, typer.Argument(metavar="WORLD", help="What `world` wrote: .zarr, .tif or a folder of tiles.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            callback=_check_picture,
            help="Picture to write, a .png; without it a window opens.",
        ),
    ] = None,
    size: given.PictureSize = None,
    kind: pictured.ViewKind = None,
    eye: pictured.Eye = None,
    look_at: pictured.LookAt = None,
    time: pictured.Hour = None,
    clouds: pictured.Clouds = None,
    quality: pictured.QualityNumber = None,
    without: pictured.Without = None,
    textures: pictured.Textures = None,
    overlay: pictured.OverlayNames = None,
    device: given.DeviceName = None,
) -> None:
    """View a written world: walk and fly in it, or render one picture of it."""
    if output is None:
        options = {
            "--size": size,
            "--view": kind,
            "--eye": eye,
            "--look-at": look_at,
            "--time": time,
            "--clouds": clouds,
            "--quality": quality,
            "--without": without,
            "--textures": textures,
            "--overlay": overlay,
        }
        for name, value in options.items():
            if value is not None and value != []:
                raise USAGE_ERROR(f"{name} needs -o: it is for pictures")
        from sketchterrain.ui.app import run_world

        restore_default_sigterm()
        raise typer.Exit(run_world(store, device=device))
    if look_at is not None and (eye is None or eye == look_at):
        raise USAGE_ERROR("--look-at needs an --eye at another place")
    if eye is not None:
        pictured.reject_combination(
            "--eye", {"--view": kind}, "either you or the program chooses where to stand"
        )
    with Stages() as stages:
        with stages.stage("program", "Loading the program"):
            from sketchterrain.app.stills import PictureOptions
            from sketchterrain.world.viewed import draw_world

        still = PictureOptions(
            size=size,
            eye=eye,
            look_at=look_at,
            view=kind or "auto",
            hour=time,
            clouds=clouds,
            quality=1.0 if quality is None else quality,
            without=tuple(without or ()),
            overlays=tuple(overlay or ()),
            textures=textures,
        )
        legend, lacks = draw_world(store, output, still, device=device, stages=stages)
    for line in lacks:
        sys.stderr.write(f"sketchterrain: note: {line}\n")
    print_lines(str(output), *legend_lines(legend))
