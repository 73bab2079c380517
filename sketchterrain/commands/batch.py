"""The command that makes many terrains: what it was asked for, and what came of it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain import arguments as given
from sketchterrain import picture_arguments as pictured
from sketchterrain.commands import target_arguments as asked
from sketchterrain.exit_codes import PARTIAL, USAGE_ERROR, fail
from sketchterrain.listings import say, say_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.batch.manifest import Entry
    from sketchterrain.batch.output import Output
    from sketchterrain.batch.plan import Item
    from sketchterrain.batch.run import Done
    from sketchterrain.batch.sweep_file import SweepFile

__all__ = ["batch"]

_MOST_JOBS = 64

Sketches = Annotated[
    list[str] | None,
    typer.Argument(metavar="[SKETCH]...", help="Sketches' folders or .sketch files, or presets' names."),
]
Seeds = Annotated[
    str | None,
    typer.Option(metavar="A-B", help="Seeds, as 1-100 or 1,5,9-12; by default each sketch's own."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUES",
        help="A setting of the sketches, as river.1.width=30, hill.1.height=100,200 or fidelity=0.2..1..0.2; "
        "several make all combinations.",
    ),
]
SweepPath = Annotated[
    Path | None,
    typer.Option("--sweep", metavar="FILE", help="All this in a TOML file; options here come first."),
]
TargetName = Annotated[
    str | None,
    typer.Option("--to", metavar="TARGET", help="Take each terrain to a target; `targets` lists them."),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        metavar="N", min=1, max=_MOST_JOBS, help="Terrains in work at once; 2 where there are cores."
    ),
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with the batch in DIR: what is whole and unchanged stays.")
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="List what would be made, what it would take, and write nothing.")
]
Foliage = Annotated[
    str | None,
    typer.Option(metavar="csv|ply|both|none", help="Plants as `generate` writes them; csv by default."),
]
Preview = Annotated[
    bool | None, typer.Option("--preview/--no-preview", help="Render previews and a contact sheet.")
]
Plants = Annotated[
    bool | None, typer.Option("--plants/--no-plants", help="With --to: write trees and shrubs.")
]


def batch(
    output: given.Folder,
    sketches: Sketches = None,
    seeds: Seeds = None,
    settings: Settings = None,
    sweep: SweepPath = None,
    jobs: Jobs = None,
    resume: Resume = False,
    dry_run: DryRun = False,
    size: asked.WholeSize = None,
    preview: Preview = None,
    view: pictured.ViewKind = None,
    foliage: Foliage = None,
    grass: given.Grass = False,
    map_kind: pictured.MapKind = None,
    target: TargetName = None,
    tiles: asked.Tiles = None,
    overlap: asked.Overlap = None,
    tile_name: asked.TileName = None,
    tile_first: asked.TileFirst = None,
    tiles_from_south: asked.TilesFromSouth = None,
    form: asked.Format = None,
    heights: asked.Heights = None,
    error: asked.MeshError = None,
    crs: asked.Crs = None,
    origin: asked.Origin = None,
    plants: Plants = None,
    device: given.DeviceName = None,
    fast: given.Fast = False,
    as_json: given.AsJson = False,
) -> None:
    """Make many terrains: every sketch with every seed and every value of its settings."""
    from sketchterrain.batch.plan import plan, read_sources
    from sketchterrain.batch.room import refuse_impossible
    from sketchterrain.batch.run import run_batch, usual_jobs
    from sketchterrain.batch.seeds import seeds_of
    from sketchterrain.batch.settings import settings_given
    from sketchterrain.batch.sweep_file import no_sweep, read_sweep
    from sketchterrain.batch.telling import Telling

    file = no_sweep() if sweep is None else read_sweep(sweep)
    of_target = {
        "tiles": tiles,
        "overlap": overlap,
        "tile_name": tile_name,
        "tile_first": tile_first,
        "tiles_from_south": tiles_from_south,
        "format": form,
        "heights": heights,
        "error": error,
        "crs": crs,
        "origin": origin,
        "plants": plants,
    }
    wanted = _output(
        file,
        {
            "size": size,
            "preview": preview,
            "view": view,
            "foliage": foliage,
            "grass": grass or None,
            "map": map_kind,
            "to": target,
        },
        of_target,
        fast=fast,
    )
    swept = settings_given(settings or (), instead_of=file.settings)
    items = plan(
        read_sources(sketches or file.sketches), file.seeds if seeds is None else seeds_of(seeds), swept
    )
    refuse_impossible(items, wanted)
    jobs = jobs or usual_jobs()
    if dry_run:
        _tell_plan(items, output, wanted, jobs=jobs, resume=resume, as_json=as_json)
        return
    with Telling() as watcher:
        done = run_batch(items, output, wanted, device=device, jobs=jobs, resume=resume, watcher=watcher)
    _tell_done(done, output, as_json=as_json)


def _output(file: SweepFile, here: dict[str, Any], of_target: dict[str, Any], *, fast: bool) -> Output:
    """Return what is written of each terrain: what the command line says, and for the rest the file."""
    from sketchterrain.batch.output import Output
    from sketchterrain.export import FoliageFiles
    from sketchterrain.export.targets import target_named
    from sketchterrain.render import check_view

    keys = {name: getattr(file.keys, name) if value is None else value for name, value in here.items()}
    options = {
        name: getattr(file.export, name) if value is None else value for name, value in of_target.items()
    }
    preview = keys["preview"] is not False
    if not preview and keys["view"] is not None:
        raise USAGE_ERROR("a view and no preview: it is the preview's")
    if keys["map"] not in (None, "png", "svg"):
        raise USAGE_ERROR(f"expected a map as png or svg, got {keys['map']!r}")
    check_view(keys["view"] or "auto")
    common = {"size": keys["size"], "preview": preview, "view": keys["view"] or "auto", "fast": fast}
    if keys["to"] is None:
        extra = next((name for name, value in options.items() if value is not None), None)
        if extra is not None:
            raise USAGE_ERROR(f"{extra.replace('_', '-')} is a target's: expected --to TARGET with it")
        files = FoliageFiles(keys["foliage"] or "csv", bool(keys["grass"]))
        return Output(**common, foliage=files.kind, grass=files.grass, map=keys["map"])
    for name in ("foliage", "map"):
        if keys[name] is not None:
            raise USAGE_ERROR(f"{name} and a target: it is for the files of `generate`")
    target_named(keys["to"])
    chosen = asked.options_of(
        size=keys["size"],
        grass=bool(keys["grass"]),
        plants=options.pop("plants") is not False,
        form=options.pop("format"),
        **options,
    )
    return Output(**common, foliage="none", target=keys["to"], options=chosen)


def _tell_plan(
    items: Sequence[Item], folder: Path, output: Output, *, jobs: int, resume: bool, as_json: bool
) -> None:
    from sketchterrain.batch.forecast import forecast
    from sketchterrain.batch.run import refuse_other

    refuse_other(folder, resume=resume)
    told = forecast(items, folder, output, jobs=jobs, resume=resume)
    if as_json:
        say_json(told.as_dict())
    else:
        say(*told.lines())


def _tell_done(done: Done, folder: Path, *, as_json: bool) -> None:
    """Tell what came of a batch; what failed as a table on stderr.

    Raises
    ------
    Exit
        With the code for partial results, if not all is there.
    """
    from msgspec import to_builtins

    entries = (*done.made, *done.skipped, *done.partial, *done.failed)
    if as_json:
        counts = {name: len(getattr(done, name)) for name in ("made", "skipped", "partial", "failed")}
        names = {entry.name for entry in entries}
        told = [entry for name, entry in done.manifest.entries.items() if name in names]
        say_json(
            {
                "folder": str(folder),
                **counts,
                "seconds": round(done.seconds, 3),
                "sheets": done.manifest.sheets,
                "items": to_builtins(told),
            }
        )
    else:
        made = len(done.made) + len(done.partial)
        rate = f", {60.0 * made / done.seconds:.1f} a minute" if made and done.seconds > 0 else ""
        there = f", {len(done.skipped)} were there" if done.skipped else ""
        say(f"{made} terrain{'' if made == 1 else 's'} made in {done.seconds:.1f} s{rate}{there}: {folder}")
        say(*(f"contact sheet: {folder / name}" for name in done.manifest.sheets))
    bad = (*done.failed, *done.partial)
    if bad:
        sys.stderr.writelines(f"{line}\n" for line in _table(bad))
        lacking = f"{len(done.failed)} of {len(entries)} terrains failed" if done.failed else ""
        without = f"{len(done.partial)} of {len(entries)} have no preview" if done.partial else ""
        told_bad = "; ".join(each for each in (lacking, without) if each)
        raise typer.Exit(fail(f"{told_bad}; --resume tries them again", PARTIAL))


def _table(entries: Sequence[Entry]) -> list[str]:
    width = max(len(entry.name) for entry in entries)
    return [f"{entry.name:<{width}}  {entry.state:<7}  {entry.error}" for entry in entries]
