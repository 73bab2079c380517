"""The command line: reads what was asked for, loads only the rooms that do it, tells what came of it.

Data goes to stdout, progress and errors to stderr. Exit codes: 0 ok, 1 failed, 2 usage, 3 bad input,
4 no device, 5 partial, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
import traceback
from typing import TYPE_CHECKING, Annotated

import typer

from sketchterrain.app import arguments as given
from sketchterrain.app import arguments as pictured
from sketchterrain.app.arguments import read_sketch
from sketchterrain.app.commands import export as taken
from sketchterrain.app.commands import info as queries
from sketchterrain.app.commands.batch import batch
from sketchterrain.app.commands.trace import trace
from sketchterrain.app.commands.world import stats, view, world
from sketchterrain.app.errors import DEBUG, INTERRUPTED, PARTIAL, USAGE_ERROR, describe_error, fail
from sketchterrain.app.listings import (
    adherence_lines,
    flown_lines,
    generated_lines,
    legend_lines,
    print_json,
    print_lines,
    undescribed_labels,
)
from sketchterrain.app.progress import Stages
from sketchterrain.io.system import restore_default_sigterm, sigterm_as_interrupt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.adherence import Adherence
    from sketchterrain.terrain.terrain import Terrain

app = typer.Typer(
    name="sketchterrain",
    help="Paint a rough sketch, get a seamless terrain that does what the sketch says.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; every failure is one line on stderr."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal that cannot show a sign must not stop the work
            stream.reconfigure(errors="replace")
    try:
        with sigterm_as_interrupt():
            command = typer.main.get_command(app)
            code = command.main(arguments, prog_name="sketchterrain", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except Exception as error:  # noqa: BLE001 - whatever it is, a person gets one line
        if os.environ.get(DEBUG):
            traceback.print_exc()
        return fail(*describe_error(error))
    if code == INTERRUPTED:
        return fail("interrupted", INTERRUPTED)
    return code if isinstance(code, int) else 0


def _show_version(wanted: bool) -> None:
    if wanted:
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


app.command()(queries.new)


@app.command()
def generate(
    sketch: given.SketchName,
    output: given.Folder,
    seed: given.Seed = None,
    size: given.Vertices = 1025,
    device: given.DeviceName = None,
    fast: given.Fast = False,
    foliage: given.FoliageKind = "csv",
    grass: given.Grass = False,
    preview: Annotated[bool, typer.Option("--preview/--no-preview", help="Render preview.png too.")] = True,
    view: pictured.ViewKind = None,
    time: pictured.Hour = None,
    clouds: pictured.Clouds = None,
    map_kind: pictured.MapKind = None,
    as_json: given.AsJson = False,
) -> None:
    """Write a terrain: heights, normals, materials, plants, features, a preview and a report."""
    if grass and foliage not in ("ply", "both"):
        raise USAGE_ERROR(f"--grass with --foliage {foliage}: only foliage.ply holds it, take ply or both")
    if not preview:
        given = {"--view": view, "--time": time, "--clouds": clouds}
        pictured.reject_combination("--no-preview", given, "it is the preview's")
    with Stages() as stages:
        document = read_sketch(sketch, seed, stages)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.app import generate as whole

            whole.check_size(document, size)
            extras = whole.PreviewOptions(preview, view or "auto", time, clouds, map_kind)
        done = whole.generate(
            document,
            output,
            device=device,
            fast=fast,
            size=size,
            foliage=whole.FoliageOptions(foliage, grass),
            extras=extras,
            stages=stages,
        )
    if as_json:
        print_json(done.report | {"folder": str(output)})
    else:
        print_lines(*generated_lines(done.report, output))
    if done.problem is not None:
        raise typer.Exit(fail(f"no preview, all other files are written: {done.problem}", PARTIAL))


@app.command()
def render(
    sketch: given.SketchName,
    output: pictured.StillFile,
    size: given.PictureSize = None,
    view: pictured.ViewKind = None,
    eye: pictured.Eye = None,
    look_at: pictured.LookAt = None,
    time: pictured.Hour = None,
    clouds: pictured.Clouds = None,
    quality: pictured.QualityNumber = None,
    without: pictured.Without = None,
    textures: pictured.Textures = None,
    overlay: pictured.OverlayNames = None,
    top_down: pictured.MapFlag = False,
    seed: given.Seed = None,
    device: given.DeviceName = None,
    fast: given.Fast = False,
) -> None:
    """Render one picture of a sketch's terrain from a view it finds or from your own, or draw a map."""
    if look_at is not None and (eye is None or eye == look_at):
        raise USAGE_ERROR("--look-at needs an --eye at another place")
    if eye is not None:
        pictured.reject_combination(
            "--eye", {"--view": view}, "either you or the program chooses where to stand"
        )
    vectors = output.suffix.lower() == ".svg"
    if top_down:
        light = {"--time": time, "--clouds": clouds, "--quality": quality, "--textures": textures}
        others = {"--eye": eye, "--view": view, **light, "--without": without, "--overlay": overlay}
        pictured.reject_combination("--map", others, "it is for pictures")
        if vectors:
            pictured.reject_combination("--map", {"--size": size}, "an .svg has no pixels")
    elif vectors:
        raise USAGE_ERROR(f"expected the name of a .png file, or --map, got {str(output)!r}")
    with Stages() as stages:
        document = read_sketch(sketch, seed, stages)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.app import stills as whole

        still = whole.PictureOptions(
            size=size,
            eye=eye,
            look_at=look_at,
            view=view or "auto",
            hour=time,
            clouds=clouds,
            quality=1.0 if quality is None else quality,
            without=tuple(without or ()),
            overlays=tuple(overlay or ()),
            textures=textures,
            top_down=top_down,
        )
        legend = whole.render_to_file(document, output, still, device=device, fast=fast, stages=stages)
    print_lines(str(output), *legend_lines(legend))


@app.command()
def fly(
    sketch: given.SketchName,
    path: given.FlightFile = None,
    output: given.FilmPlace = None,
    size: given.FilmSize = "1280x720",
    seconds: given.Seconds = None,
    fps: given.Fps = 30,
    time: pictured.Hour = None,
    clouds: pictured.Clouds = None,
    quality: given.FrameQuality = None,
    without: pictured.Without = None,
    textures: pictured.Textures = None,
    real_time: given.RealTime = False,
    overlay: pictured.OverlayNames = None,
    seed: given.Seed = None,
    device: given.DeviceName = None,
    fast: given.Fast = False,
    as_json: given.AsJson = False,
) -> None:
    """Fly over a sketch's terrain along a path: a film of it, and what its frames took."""
    with Stages() as stages:
        document = read_sketch(sketch, seed, stages)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.app import fly as whole
            from sketchterrain.render.flight import load_flight
            from sketchterrain.render.overlays import check_overlays

            check_overlays(overlay or ())
            flight = None if path is None else load_flight(path)
        take = whole.FlightOptions(
            size,
            fps,
            seconds,
            quality,
            real_time,
            tuple(overlay or ()),
            hour=time,
            clouds=clouds,
            without=tuple(without or ()),
            textures=textures,
        )
        flown = whole.fly(document, flight, take, output=output, device=device, fast=fast, stages=stages)
    flown["path"] = None if path is None else str(path)
    if as_json:
        print_json(flown)
    else:
        print_lines(*flown_lines(flown))


@app.command()
def adherence(
    sketch: given.SketchName,
    output: given.OptionalPictureFile = None,
    seed: given.Seed = None,
    device: given.DeviceName = None,
    as_json: given.AsJson = False,
) -> None:
    """Measure how far the terrain does what its sketch says; with -o, show where it does not."""
    with Stages() as stages:
        document = read_sketch(sketch, seed, stages)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.app.jobs import run_with_fallback
            from sketchterrain.terrain.adherence import measure_adherence
            from sketchterrain.terrain.building import build

        def work(context: ComputeContext, _: tuple[str, ...]) -> tuple[Terrain, Adherence]:
            with stages.stage("features", "Placing features"):
                terrain = build(document, device=context)
            with stages.stage("adherence", "Comparing with the sketch"):
                return terrain, measure_adherence(terrain)

        terrain, found = run_with_fallback(work, device=device, stages=stages)
        if output is not None:
            from sketchterrain.export.files import prepare_folder
            from sketchterrain.export.sidecar import write_adherence_image

            prepare_folder(output.parent)
            write_adherence_image(output, terrain, found)
    entry = {"sketch": document.name, "seed": document.seed, "fidelity": document.fidelity}
    entry |= {**found.as_dict(), "notes": undescribed_labels(document)}
    if as_json:
        print_json(entry)
    else:
        print_lines(*adherence_lines(entry), *([f"picture: {output}"] if output is not None else []))


@app.command()
def edit(
    sketch: Annotated[
        str | None,
        typer.Argument(metavar="[SKETCH]", help="A sketch's folder or .sketch file, or a preset's name."),
    ] = None,
) -> None:
    """Open the desktop program: paint, see the terrain follow, change what was generated."""
    from sketchterrain.ui.app import run

    restore_default_sigterm()  # no exceptions inside Qt's event loop; autosave recovers unsaved work
    raise typer.Exit(run(sketch))


for _command in (
    batch,
    world,
    stats,
    view,
    taken.export,
    taken.targets,
    trace,
    queries.bench,
    queries.devices,
    queries.presets,
):
    app.command()(_command)
