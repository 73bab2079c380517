# ruff: noqa: TC003 - typer reads the commands' annotations at run time
"""The command line: reads what was asked for, loads only the rooms that do it, tells what came of it.

Data goes to stdout, progress and errors to stderr. Exit codes: 0 ok, 1 failed, 2 usage, 3 bad input,
4 no device, 5 partial, 130 interrupted.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sketchterrain.arguments import (
    AsJson,
    DeviceName,
    Eye,
    Fast,
    FilmPlace,
    FlightFile,
    Folder,
    Fps,
    LookAt,
    OptionalPictureFile,
    OverlayNames,
    PictureFile,
    PictureSize,
    QualityNumber,
    RealTime,
    Seconds,
    Seed,
    SketchName,
    Vertices,
    camera_at,
)
from sketchterrain.exit_codes import DEBUG, INTERRUPTED, PARTIAL, USAGE_ERROR, fail, told
from sketchterrain.listings import (
    adherence_lines,
    device_lines,
    flown_lines,
    generated_lines,
    legend_lines,
    preset_entry,
    preset_lines,
    tested_entry,
    undescribed_labels,
)
from sketchterrain.progress import Stages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.compute import ComputeContext
    from sketchterrain.render.overlays import Legend
    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain import Adherence, Terrain

__all__ = ["app", "main"]

app = typer.Typer(
    name="sketchterrain",
    help="Paint a rough sketch, get a seamless terrain that does what the sketch says.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; every failure is one line on stderr.

    Parameters
    ----------
    arguments
        By default those of the process.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal that cannot show a sign must not stop the work
            stream.reconfigure(errors="replace")
    try:
        code = typer.main.get_command(app).main(arguments, prog_name="sketchterrain", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except Exception as error:  # noqa: BLE001 - whatever it is, a person gets one line
        if os.environ.get(DEBUG):
            traceback.print_exc()
        return fail(*told(error))
    if code == INTERRUPTED:
        return fail("interrupted", INTERRUPTED)
    return code if isinstance(code, int) else 0


def _say(*lines: str) -> None:
    sys.stdout.writelines(f"{line}\n" for line in lines)


def _say_json(value: object) -> None:
    _say(json.dumps(value, indent=2, ensure_ascii=False))


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        _say(f"sketchterrain {version('sketchterrain')}")
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


@app.command()
def new(folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new or an empty folder.")]) -> None:
    """Write a starter sketch, to be painted in any paint program."""
    from sketchterrain.sketch import new_sketch

    new_sketch(folder)
    _say(
        f"wrote a starter sketch to {folder}: paint its PNGs, read its sketch.toml, then run",
        f"sketchterrain generate {folder} -o out",
    )


@app.command()
def generate(
    sketch: SketchName,
    output: Folder,
    seed: Seed = None,
    size: Vertices = 1025,
    device: DeviceName = None,
    fast: Fast = False,
    preview: Annotated[bool, typer.Option("--preview/--no-preview", help="Render preview.png too.")] = True,
    as_json: AsJson = False,
) -> None:
    """Write a terrain: heights, normals, materials, plants, features, a preview and a report."""
    with Stages() as stages:
        with stages.stage("sketch", "Reading the sketch"):
            document = _load(sketch, seed)
        with stages.stage("program", "Loading the program"):
            from sketchterrain import generate as whole

            whole.check_size(document, size)
        done = whole.generate(
            document, output, device=device, fast=fast, size=size, preview=preview, stages=stages
        )
    if as_json:
        _say_json(done.report | {"folder": str(output)})
    else:
        _say(*generated_lines(done.report, output))
    if done.problem is not None:
        raise typer.Exit(fail(f"no preview, all other files are written: {done.problem}", PARTIAL))


@app.command()
def render(
    sketch: SketchName,
    output: PictureFile,
    size: PictureSize = "1280x720",
    eye: Eye = None,
    look_at: LookAt = None,
    overlay: OverlayNames = None,
    seed: Seed = None,
    device: DeviceName = None,
    fast: Fast = False,
) -> None:
    """Render one picture of a sketch's terrain, from a camera that shows it all or from your own."""
    if look_at is not None and (eye is None or eye == look_at):
        raise USAGE_ERROR("--look-at needs an --eye at another place")
    with Stages() as stages:
        with stages.stage("sketch", "Reading the sketch"):
            document = _load(sketch, seed)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.export import prepare_folder, write_picture
            from sketchterrain.jobs import run_job
            from sketchterrain.render import check_overlays, render_picture
            from sketchterrain.terrain import build

            check_overlays(overlay or ())

        def work(context: ComputeContext, _: tuple[str, ...]) -> list[Legend]:
            with stages.stage("features", "Placing features"):
                terrain = build(document, device=context)
            with stages.stage("picture", "Rendering"):
                prepare_folder(output.parent)
                camera = camera_at(terrain, eye, look_at)
                legend: list[Legend] = []
                picture = render_picture(
                    terrain, size=size, camera=camera, overlays=overlay or (), legend=legend
                )
                write_picture(output, picture)
            return legend

        legend = run_job(work, device=device, fast=fast, stages=stages)
    _say(str(output), *legend_lines(legend))


@app.command()
def fly(
    sketch: SketchName,
    path: FlightFile = None,
    output: FilmPlace = None,
    size: PictureSize = "1280x720",
    seconds: Seconds = None,
    fps: Fps = 30,
    quality: QualityNumber = None,
    real_time: RealTime = False,
    overlay: OverlayNames = None,
    seed: Seed = None,
    device: DeviceName = None,
    fast: Fast = False,
    as_json: AsJson = False,
) -> None:
    """Fly over a sketch's terrain along a path: a film of it, and what its frames took."""
    with Stages() as stages:
        with stages.stage("sketch", "Reading the sketch"):
            document = _load(sketch, seed)
        with stages.stage("program", "Loading the program"):
            from sketchterrain import fly as whole
            from sketchterrain.render import check_overlays, load_flight

            check_overlays(overlay or ())
            flight = None if path is None else load_flight(path)
        take = whole.Take(size, fps, seconds, quality, real_time, tuple(overlay or ()))
        told = whole.fly(document, flight, take, output=output, device=device, fast=fast, stages=stages)
    told["path"] = None if path is None else str(path)
    if as_json:
        _say_json(told)
    else:
        _say(*flown_lines(told))


@app.command()
def adherence(
    sketch: SketchName,
    output: OptionalPictureFile = None,
    seed: Seed = None,
    device: DeviceName = None,
    as_json: AsJson = False,
) -> None:
    """Measure how far the terrain does what its sketch says; with -o, show where it does not."""
    with Stages() as stages:
        with stages.stage("sketch", "Reading the sketch"):
            document = _load(sketch, seed)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.jobs import run_job
            from sketchterrain.terrain import build, measure_adherence

        def work(context: ComputeContext, _: tuple[str, ...]) -> tuple[Terrain, Adherence]:
            with stages.stage("features", "Placing features"):
                terrain = build(document, device=context)
            with stages.stage("adherence", "Comparing with the sketch"):
                return terrain, measure_adherence(terrain)

        terrain, found = run_job(work, device=device, stages=stages)
        if output is not None:
            from sketchterrain.export import prepare_folder, write_agreement

            prepare_folder(output.parent)
            write_agreement(output, terrain, found)
    entry = {"sketch": document.name, "seed": document.seed, "fidelity": document.fidelity}
    entry |= {**found.as_dict(), "notes": undescribed_labels(document)}
    if as_json:
        _say_json(entry)
    else:
        _say(*adherence_lines(entry), *([f"picture: {output}"] if output is not None else []))


@app.command()
def bench(
    names: Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="All if none.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Write tables and charts there.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes, few rounds.")] = False,
    device: DeviceName = None,
    fast: Fast = False,
    as_json: AsJson = False,
) -> None:
    """Time kernels, noise, tiles, features and plants, and chart them."""
    from sketchterrain.benchmarks import run

    code = run(names or [], output=output, quick=quick, device=device, fast=fast, as_json=as_json)
    raise typer.Exit(code)


@app.command()
def devices(as_json: AsJson = False) -> None:
    """List the OpenCL devices, test whether each computes the same bits and how it reaches OpenGL."""
    from sketchterrain.compute import choose_device, list_devices
    from sketchterrain.render.sharing_probe import probe_sharing
    from sketchterrain.terrain import self_test

    chosen, tested = choose_device(), []
    with Stages() as stages:
        for device in list_devices():
            with stages.stage(str(device.index), f"Testing {device.name} ({device.platform})"):
                tested.append((device, self_test(device), probe_sharing(device)))
    if as_json:
        _say_json([tested_entry(*each) | {"default": each[0] == chosen} for each in tested])
        return
    for device, verdict, sharing in tested:
        _say(*device_lines(device, verdict, sharing, chosen=device == chosen))


@app.command()
def presets(as_json: AsJson = False) -> None:
    """List the presets, which can stand wherever a sketch can."""
    from sketchterrain.resources import preset_names

    entries = [preset_entry(name, _load(name, None)) for name in preset_names()]
    if as_json:
        _say_json(entries)
    else:
        _say(*preset_lines(entries))


def _load(name: str, seed: int | None) -> Sketch:
    from sketchterrain.sketch import load_sketch

    sketch = load_sketch(name)
    return sketch if seed is None else sketch.replace(seed=seed)
