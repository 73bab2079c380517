"""The command line: `main`, and the commands for one sketch.

Data goes to stdout, progress and errors to stderr. Exit codes: 0 ok, 1 failed, 2 usage, 3 bad input,
4 no device, 5 partial, 130 interrupted. A command imports what it needs when it runs.
"""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from sketchterrain.app import arguments as args
from sketchterrain.app.commands.exports import batch, blender_extension, export, targets
from sketchterrain.app.commands.trace import new, trace
from sketchterrain.app.commands.world import stats, view, world
from sketchterrain.app.listings import (
    device_lines,
    device_test_entry,
    flight_lines,
    generated_lines,
    legend_lines,
    preset_entry,
    preset_lines,
    print_json,
    print_lines,
    print_result,
)
from sketchterrain.app.option_groups import reject_combination, with_option_groups
from sketchterrain.io.console import (
    DEBUG,
    INTERRUPTED,
    PARTIAL,
    USAGE_ERROR,
    Stages,
    describe_error,
    fail,
    standard_streams,
)
from sketchterrain.io.system import restore_default_sigterm, sigterm_as_interrupt
from sketchterrain.measure.lines import adherence_lines, realism_lines

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.generation.terrain import Terrain


T = TypeVar("T")

app = typer.Typer(
    name="sketchterrain",
    help="Paint a rough sketch, get a seamless terrain that matches it.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; every failure is one line on stderr."""
    given = sys.argv[1:] if arguments is None else arguments
    with standard_streams():
        try:
            if any(re.fullmatch("(--[^=]+=)?", each) for each in given):  # a path would be the current folder
                raise USAGE_ERROR("expected a value, got an empty text")
            with sigterm_as_interrupt():
                command = typer.main.get_command(app)
                code = command.main(given, prog_name="sketchterrain", standalone_mode=False)
        except (KeyboardInterrupt, typer.Abort):
            code = INTERRUPTED
        except Exception as error:  # noqa: BLE001 - any error is one line
            if os.environ.get(DEBUG):
                traceback.print_exc()
            return fail(*describe_error(error))
        if code == INTERRUPTED:
            return fail("interrupted", INTERRUPTED)
        return code if isinstance(code, int) else 0


def _show_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        print_lines(f"sketchterrain {version('sketchterrain')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _program(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        raise USAGE_ERROR("expected a command; `sketchterrain --help` lists them")


app.command()(new)


@app.command()
def generate(
    sketch: args.SketchName,
    output: args.Folder,
    seed: args.Seed = None,
    size: Annotated[int, typer.Option(metavar="N", help="Vertices along the longer side.")] = 1025,
    device: args.DeviceName = None,
    fast: args.Fast = False,
    foliage: args.FoliageKind = "csv",
    grass: args.Grass = False,
    preview: Annotated[bool, typer.Option("--preview/--no-preview", help="Render preview.png too.")] = True,
    view: args.ViewKind = None,
    time: args.Hour = None,
    sky: args.Sky = None,
    clouds: args.Clouds = None,
    map_kind: args.MapKind = None,
    layer: args.LayerFiles = None,
    as_json: args.AsJson = False,
) -> None:
    """Write a terrain: heights, normals, materials, plants, features, a preview and a report."""
    if grass and foliage not in ("ply", "both"):
        raise USAGE_ERROR(f"--grass with --foliage {foliage}: expected --foliage ply or both")
    if not preview:
        light = {"--view": view, "--time": time, "--sky": sky, "--clouds": clouds}
        reject_combination("--no-preview", light, "it is the preview's")
    costs = {"features": 10, "ground": 3, "plants": 22, "adherence": 9, "realism": 4, "files": 4}
    costs |= {"preview": 18} if preview else {}
    costs |= {"map": 30} if map_kind else {}
    with Stages(costs=costs) as stages:
        document = args.read_sketch(sketch, seed, stages, layer)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.export.foliage_files import FoliageOptions
            from sketchterrain.jobs import generate as app
            from sketchterrain.jobs.estimates import check_size

            check_size(document, size)
            plants = FoliageOptions(foliage, grass)
            options = app.GenerateOptions(size, plants, preview, view or "auto", time, sky, clouds, map_kind)
        done = app.generate(document, output, options, device=device, fast=fast, stages=stages)
    print_result(done.report | {"folder": str(output)}, generated_lines(done.report, output), as_json=as_json)
    if done.problem is not None:
        raise typer.Exit(fail(f"no preview, all other files are written: {done.problem}", PARTIAL))


@app.command()
@with_option_groups
def render(
    sketch: args.SketchName,
    output: args.RenderFile,
    *,
    picture: args.PictureArguments,
    top_down: Annotated[bool, typer.Option("--map", help="A topographic map instead, .png or .svg.")] = False,
    seed: args.Seed = None,
    device: args.DeviceName = None,
    fast: args.Fast = False,
) -> None:
    """Render a picture of a sketch's terrain from an automatic view or your own, or draw a map."""
    picture.check_camera()
    is_svg = output.suffix.lower() == ".svg"
    if top_down:
        others = {f"--{name.replace('_', '-')}": value for name, value in vars(picture).items()}
        size, _ = others.pop("--size"), others.pop("--layer")
        reject_combination("--map", others, "it is for pictures")
        if is_svg:
            reject_combination("--map", {"--size": size}, "an .svg has no pixels")
    elif is_svg:
        raise USAGE_ERROR(f"expected the name of a .png file, or --map, got {str(output)!r}")
    with Stages() as stages:
        document = args.read_sketch(sketch, seed, stages, picture.layer)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.jobs import pictures as app
        options = app.PictureOptions(**picture.given(), top_down=top_down)
        legend = app.render_to_file(document, output, options, device=device, fast=fast, stages=stages)
    print_lines(str(output), *legend_lines(legend))


@app.command()
@with_option_groups
def fly(
    sketch: args.SketchName,
    path: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Path file; by default a tour of the sketch."),
    ] = None,
    output: args.FilmPlace = None,
    *,
    seconds: args.Seconds = None,
    fps: Annotated[int, typer.Option(metavar="N", min=1, max=240, help="Frames a second.")] = 30,
    real_time: Annotated[
        bool,
        typer.Option("--real-time", help="Draw frames within a time budget, as a viewer; else complete."),
    ] = False,
    picture: args.SceneArguments,
    seed: args.Seed = None,
    device: args.DeviceName = None,
    fast: args.Fast = False,
    as_json: args.AsJson = False,
) -> None:
    """Fly over a sketch's terrain along a path: write a film, and report frame statistics."""
    with Stages() as stages:
        document = args.read_sketch(sketch, seed, stages, picture.layer)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.jobs import pictures as app
            from sketchterrain.render.flight import load_flight
            from sketchterrain.render.overlays import check_overlays

            check_overlays(picture.overlay or ())
            flight = None if path is None else load_flight(path)
        options = app.FlightOptions(**picture.given(), fps=fps, seconds=seconds, real_time=real_time)
        report = app.fly(document, flight, options, output=output, device=device, fast=fast, stages=stages)
    report["path"] = None if path is None else str(path)
    print_result(report, flight_lines(report), as_json=as_json)


@app.command()
def adherence(
    sketch: args.SketchName,
    output: args.PictureFile = None,
    seed: args.Seed = None,
    device: args.DeviceName = None,
    as_json: args.AsJson = False,
) -> None:
    """Measure the adherence of a terrain to its sketch; with -o, draw where they differ."""
    with Stages() as stages:
        document = args.read_sketch(sketch, seed, stages)
        if output is not None:
            from sketchterrain.export.files import prepare_folder

            prepare_folder(output.parent)
        from sketchterrain.measure.adherence import measure_adherence

        stage = "adherence", "Comparing with the sketch"
        terrain, found = _measured(document, device, stages, stage, measure_adherence)
        if output is not None:
            from sketchterrain.export.measured_maps import write_adherence_image

            write_adherence_image(output, terrain, found)
    from sketchterrain.document.sketch import sketch_notes

    entry = {"sketch": document.name, "seed": document.seed, "fidelity": document.fidelity}
    entry |= {**found.as_dict(), "notes": sketch_notes(document)}
    lines = [*adherence_lines(entry), *([] if output is None else [f"picture: {output}"])]
    print_result(entry, lines, as_json=as_json)


@app.command()
def edit(
    sketch: Annotated[
        str | None,
        typer.Argument(metavar="[SKETCH]", help="A sketch's folder or .sketch file, or a preset's name."),
    ] = None,
) -> None:
    """Open the desktop program: paint, see the terrain, edit generated features."""
    from sketchterrain.ui.app import run

    restore_default_sigterm()  # no exceptions inside Qt's event loop; autosave recovers unsaved work
    raise typer.Exit(run(sketch))


@app.command()
def bench(
    names: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="All if none.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write tables and charts there.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes, few rounds.")] = False,
    device: args.DeviceName = None,
    fast: args.Fast = False,
    as_json: args.AsJson = False,
) -> None:
    """Time kernels, noise, tiles, features and plants, and chart them."""
    from sketchterrain.benchmarks import run

    code = run(names or [], output=output, quick=quick, device=device, fast=fast, as_json=as_json)
    raise typer.Exit(code)


@app.command()
def devices(as_json: args.AsJson = False) -> None:
    """List the OpenCL devices, with a self-test of their bits and of sharing with OpenGL."""
    from sketchterrain.compute.device import choose_device, list_devices
    from sketchterrain.compute.device_check import clear_check_results
    from sketchterrain.errors import DeviceFailedError
    from sketchterrain.generation.self_test import self_test
    from sketchterrain.render.sharing_probe import Sharing, probe_sharing

    clear_check_results()  # a missing driver or linker may be installed by now
    default, tested = None, []
    with suppress(DeviceFailedError):  # the self-test reports it
        default = choose_device()
    with Stages() as stages:
        for device in list_devices():
            with stages.stage(str(device.index), f"Testing {device.name} ({device.platform})"):
                verdict = self_test(device)
                failed = verdict.bits == "failed"
                sharing = Sharing("none", "it runs no kernel") if failed else probe_sharing(device)
                tested.append((device, verdict, sharing))
    if as_json:
        print_json([device_test_entry(*test) | {"default": test[0] == default} for test in tested])
        return
    for device, verdict, sharing in tested:
        print_lines(*device_lines(device, verdict, sharing, default=device == default))


@app.command()
def presets(as_json: args.AsJson = False) -> None:
    """List the presets, which can be used as sketches."""
    from sketchterrain.document.store import load_sketch
    from sketchterrain.io.resources import preset_names

    entries = [preset_entry(name, load_sketch(name)) for name in preset_names()]
    print_result(entries, preset_lines(entries), as_json=as_json)


_RASTERS = (".tif", ".tiff", ".npy")


def realism(
    source: Annotated[
        str, typer.Argument(metavar="SKETCH|FILE", help="A sketch, or heights: a GeoTIFF or a .npy array.")
    ],
    cell: Annotated[
        float | None,
        typer.Option(metavar="M", min=0.01, help="Cell size; by default 30 m, or the raster's own."),
    ] = None,
    size: Annotated[
        int, typer.Option(metavar="N", min=96, help="Least cells along a side of a sketch.")
    ] = 192,
    kind: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND", help="Kinds of land to compare with; by default the nearest usual one."),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE.png", help="Draw hollows, rising channels and walls."),
    ] = None,
    seed: args.Seed = None,
    device: args.DeviceName = None,
    as_json: args.AsJson = False,
) -> None:
    """Measure how far landforms are from those of real land; with --map, draw where."""
    if map_file is not None:
        if map_file.suffix.lower() != ".png":
            raise USAGE_ERROR(f"--map: expected the name of a .png file, got {str(map_file)!r}")
        from sketchterrain.export.files import prepare_folder

        prepare_folder(map_file.parent)
    from sketchterrain.measure import realism as measuring

    kinds, stage = tuple(kind or ()), ("realism", "Comparing with real land")
    header: dict[str, Any] = {"file": source}
    with Stages() as stages:
        if Path(source).suffix.lower() in _RASTERS:
            if seed is not None or device is not None:
                raise USAGE_ERROR("--seed and --device are for sketches, not for rasters")
            with stages.stage(*stage):
                from sketchterrain.importing.elevation import read_heights

                height, step = read_heights(Path(source), cell)
                found = measuring.measure_realism(height, step, kinds=kinds)
        else:
            document = args.read_sketch(source, seed, stages)
            header = {"sketch": document.name, "seed": document.seed}
            options: dict[str, Any] = {"cell": cell or measuring.DEFAULT_CELL, "size": size, "kinds": kinds}
            measure = partial(measuring.measure_terrain_realism, **options)
            _, found = _measured(document, device, stages, stage, measure)
    if map_file is not None:
        from sketchterrain.export.measured_maps import write_realism_map

        write_realism_map(map_file, found)
    entry = header | found.as_dict()
    lines = [*realism_lines(entry), *([] if map_file is None else [f"map: {map_file}"])]
    print_result(entry, lines, as_json=as_json)


def _measured(
    sketch: Sketch,
    device: str | None,
    stages: Stages,
    stage: tuple[str, str],
    measure: Callable[[Terrain], T],
) -> tuple[Terrain, T]:
    """Return a sketch's terrain and what is measured of it in a stage (name and title)."""
    with stages.stage("program", "Loading the program"):
        from sketchterrain.jobs.export import DeviceFallback, build_terrain

    def work(context: ComputeContext, _: tuple[str, ...]) -> tuple[Terrain, T]:
        terrain = build_terrain(sketch, context, stages, kernels=["points.cl"])
        with stages.stage(*stage):
            return terrain, measure(terrain)

    return DeviceFallback(device).run(work, stages=stages)


for _command in (batch, world, stats, view, export, targets, blender_extension, realism, trace):
    app.command()(_command)
