"""Commands `export`, `targets` and `batch`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain.app import arguments as args
from sketchterrain.app.listings import (
    exported_lines,
    print_json,
    print_lines,
    print_result,
    target_entry,
    target_lines,
)
from sketchterrain.app.option_groups import with_option_groups
from sketchterrain.io.console import PARTIAL, USAGE_ERROR, Stages, fail, pluralize, print_note

if TYPE_CHECKING:
    from sketchterrain.batch.plan import Item, SweepFile
    from sketchterrain.batch.results import Output
    from sketchterrain.batch.run import BatchResult


@with_option_groups
def export(
    sketch: args.SketchName,
    target: args.TargetName,
    output: args.Folder,
    *,
    size: args.WholeSize = None,
    exported: args.ExportArguments,
    grass: args.Grass = False,
    layer: args.LayerFiles = None,
    seed: args.Seed = None,
    device: args.DeviceName = None,
    fast: args.Fast = False,
    as_json: args.AsJson = False,
) -> None:
    """Export a terrain to an engine, a GIS or a plain format, in the size and orientation it expects."""
    options = exported.options(size, grass=grass)
    with Stages() as stages:
        document = args.read_sketch(sketch, seed, stages, layer)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.jobs import export as app
        done = app.export(document, output, target, options, device=device, fast=fast, stages=stages)
    entry = done.report | {"folder": str(output), "timings": stages.seconds | {"total": stages.elapsed}}
    print_result(entry, exported_lines(done.report, output, stages.elapsed), as_json=as_json)


def targets(as_json: args.AsJson = False) -> None:
    """List the export targets: sizes, formats, options and required libraries."""
    from sketchterrain.export.targets import TARGET_NAMES, target_named

    entries = [target_entry(target_named(name)) for name in TARGET_NAMES]
    print_result(entries, (line for entry in entries for line in target_lines(entry)), as_json=as_json)


def blender_extension(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.zip", help="The file to write.")
    ] = Path("sketchterrain_blender.zip"),
) -> None:
    """Write the extension for Blender that imports exports for it: File, Import, Sketchterrain."""
    from sketchterrain.export.targets.gltf import write_extension

    print_lines(
        f"{write_extension(output)}: drag it into Blender, or Preferences, Add-ons, Install from Disk"
    )


_MAX_JOBS = 64


@with_option_groups
def batch(
    output: args.Folder,
    *,
    sketches: Annotated[
        list[str] | None, typer.Argument(metavar="[SKETCH]...", help="Folders, .sketch files or presets.")
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(metavar="A-B", help="Seeds, as 1-100 or 1,5,9-12; by default each sketch's own."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUES",
            help="A setting of the sketches, as river.1.width=30, hill.1.height=100,200 or "
            "fidelity=0.2..1..0.2; several make all combinations.",
        ),
    ] = None,
    sweep: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="All this in a TOML file; options take precedence."),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=_MAX_JOBS, help="Concurrent terrains, by default 2.")
    ] = None,
    resume: args.Resume = False,
    dry_run: args.DryRun = False,
    size: args.WholeSize = None,
    preview: Annotated[
        bool | None, typer.Option("--preview/--no-preview", help="Render previews and a contact sheet.")
    ] = None,
    view: args.ViewKind = None,
    foliage: Annotated[
        str | None,
        typer.Option(metavar="csv|ply|both|none", help="Plants as `generate` writes them; csv by default."),
    ] = None,
    grass: args.Grass = False,
    map_kind: args.MapKind = None,
    target: Annotated[
        str | None,
        typer.Option("--to", metavar="TARGET", help="Export each terrain to a target; `targets` lists them."),
    ] = None,
    exported: args.ExportArguments,
    device: args.DeviceName = None,
    fast: args.Fast = False,
    as_json: args.AsJson = False,
) -> None:
    """Generate many terrains: every sketch with every seed and every value of its settings."""
    from msgspec import structs

    from sketchterrain.batch.plan import (
        SweepFile,
        parse_seeds,
        parse_settings,
        plan,
        read_sources,
        read_sweep,
    )
    from sketchterrain.batch.results import BatchProgress
    from sketchterrain.batch.run import run_batch

    keys: dict[str, Any] = {"size": size, "preview": preview, "view": view, "foliage": foliage}
    keys |= {"grass": grass or None, "map": map_kind, "to": target}
    given = {name: value for name, value in keys.items() if value is not None}
    file = structs.replace(SweepFile() if sweep is None else read_sweep(sweep), **given)
    written = _output(file, args.ExportArguments(**file.export | exported.given()), fast=fast)
    swept = parse_settings(settings or (), file.settings)
    sources = read_sources(sketches or file.sketches)
    for each in filter(None, (source.sketch for source in sources)):
        print_note(*each.notes)
    items = plan(sources, file.seed_list if seeds is None else parse_seeds(seeds), swept)
    jobs = jobs or min(2, os.cpu_count() or 1)
    if dry_run:
        _report_plan(items, output, written, jobs=jobs, resume=resume, as_json=as_json)
        return
    with BatchProgress() as progress:
        done = run_batch(items, output, written, device=device, jobs=jobs, resume=resume, progress=progress)
    _report_done(done, output, as_json=as_json)


def _output(file: SweepFile, exported: args.ExportArguments, *, fast: bool) -> Output:
    """Return the files to write of each terrain, from a sweep file and the options of its target."""
    from sketchterrain.batch.results import Output
    from sketchterrain.export.foliage_files import FoliageOptions
    from sketchterrain.export.targets import target_named
    from sketchterrain.render.views import check_view

    preview, view = file.preview is not False, file.view or "auto"
    if not preview and file.view is not None:
        raise USAGE_ERROR("a view without a preview: it is the preview's")
    if file.map not in (None, "png", "svg"):
        raise USAGE_ERROR(f"expected a map as png or svg, got {file.map!r}")
    check_view(view)
    if file.to is None:
        extra = next(iter(exported.given()), None)
        if extra is not None:
            raise USAGE_ERROR(f"{extra.replace('_', '-')} needs --to TARGET")
        files = FoliageOptions(file.foliage or "csv", bool(file.grass))
        return Output(file.size, preview, view, files.kind, files.grass, file.map, fast=fast)
    for name in ("foliage", "map"):
        if getattr(file, name) is not None:
            raise USAGE_ERROR(f"{name} with a target: it is for the files of `generate`")
    target_named(file.to)
    options = exported.options(file.size, grass=bool(file.grass))
    return Output(file.size, preview, view, "none", target=file.to, options=options, fast=fast)


def _report_plan(
    items: Sequence[Item], folder: Path, output: Output, *, jobs: int, resume: bool, as_json: bool
) -> None:
    from sketchterrain.batch.results import Needs
    from sketchterrain.batch.run import check_folder, estimate_batch, estimate_items, finished_items

    needs = estimate_items(items, output)
    check_folder(folder, resume=resume)
    whole = finished_items(items, folder, output)
    missing = {name: need for name, need in needs.items() if isinstance(need, Needs) and name not in whole}
    jobs, estimate = estimate_batch(missing.values(), output, jobs)
    states = [
        "there" if item.name in whole else "to make" if item.name in missing else "fails" for item in items
    ]
    problems = ["" if isinstance(need, Needs) else str(need) for need in needs.values()]
    if as_json:
        listed = [
            {
                "name": item.name,
                "sketch": item.source.given,
                "seed": item.seed,
                "settings": dict(item.settings),
                "state": state,
                "vertices": getattr(needs[item.name], "vertices", None),
                "error": problem,
            }
            for item, state, problem in zip(items, states, problems, strict=True)
        ]
        print_json({"folder": str(folder), "jobs": jobs, **estimate.as_dict(folder), "items": listed})
        return
    width = max(len(item.name) for item in items)
    for item, state, problem in zip(items, states, problems, strict=True):
        print_lines(f"{item.name:<{width}}  {problem or state}")
    print_lines(
        f"{pluralize(len(missing), 'terrain')} to write to {folder}, {jobs} at once", *estimate.lines(folder)
    )


def _report_done(done: BatchResult, folder: Path, *, as_json: bool) -> None:
    """Print the result, with failures as a table on stderr; exit with the code for partial results."""
    from msgspec import to_builtins

    new = [entry for entry in done.entries if entry.name not in done.skipped]
    complete, partial, failed = (
        [entry for entry in new if entry.state == state] for state in ("done", "partial", "failed")
    )
    if as_json:
        counts = {
            "made": len(complete),
            "skipped": len(done.skipped),
            "partial": len(partial),
            "failed": len(failed),
        }
        facts = {"folder": str(folder), **counts, "seconds": round(done.seconds, 3), "sheets": done.sheets}
        print_json(facts | {"items": to_builtins(done.entries)})
    else:
        count = len(complete) + len(partial)
        rate = f", {60.0 * count / done.seconds:.1f} a minute" if count and done.seconds > 0 else ""
        there = f", {len(done.skipped)} unchanged" if done.skipped else ""
        print_lines(f"{pluralize(count, 'terrain')} written in {done.seconds:.1f} s{rate}{there}: {folder}")
        print_lines(*(f"contact sheet: {folder / name}" for name in done.sheets))
    bad = [*failed, *partial]
    if bad:
        width = max(len(entry.name) for entry in bad)
        sys.stderr.writelines(f"{entry.name:<{width}}  {entry.state:<7}  {entry.error}\n" for entry in bad)
        lost = f"{len(failed)} of {len(done.entries)} terrains failed" if failed else ""
        bare = f"{len(partial)} of {len(done.entries)} have no preview" if partial else ""
        problems = "; ".join(problem for problem in (lost, bare) if problem)
        raise typer.Exit(fail(f"{problems}; --resume tries them again", PARTIAL))
