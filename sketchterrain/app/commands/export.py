"""Commands `export` and `targets`."""

from __future__ import annotations

from sketchterrain.app import arguments as args
from sketchterrain.app.listings import exported_lines, print_json, print_lines, target_entry, target_lines
from sketchterrain.app.progress import Stages


def export(
    sketch: args.SketchName,
    target: args.TargetName,
    output: args.Folder,
    size: args.WholeSize = None,
    tiles: args.Tiles = None,
    overlap: args.Overlap = None,
    tile_name: args.TileName = None,
    tile_first: args.TileFirst = None,
    tiles_from_south: args.TilesFromSouth = None,
    form: args.Format = None,
    heights: args.Heights = None,
    error: args.MeshError = None,
    crs: args.Crs = None,
    origin: args.Origin = None,
    plants: args.Plants = None,
    grass: args.Grass = False,
    seed: args.Seed = None,
    device: args.DeviceName = None,
    fast: args.Fast = False,
    as_json: args.AsJson = False,
) -> None:
    """Export a terrain to an engine, a GIS or a plain format, in the size and orientation it expects."""
    options = args.export_options(
        size=size,
        tiles=tiles,
        overlap=overlap,
        tile_name=tile_name,
        tile_first=tile_first,
        tiles_from_south=tiles_from_south,
        form=form,
        heights=heights,
        error=error,
        crs=crs,
        origin=origin,
        plants=plants,
        grass=grass,
    )
    with Stages() as stages:
        document = args.read_sketch(sketch, seed, stages)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.app import export as app
        done = app.export(document, output, target, options, device=device, fast=fast, stages=stages)
    if as_json:
        timings = stages.seconds | {"total": stages.elapsed}
        print_json(done.report | {"folder": str(output), "timings": timings})
    else:
        print_lines(*exported_lines(done.report, output, stages.elapsed))


def targets(as_json: args.AsJson = False) -> None:
    """List the export targets: sizes, formats, options and required libraries."""
    from sketchterrain.export.targets import TARGET_NAMES, target_named

    entries = [target_entry(target_named(name)) for name in TARGET_NAMES]
    if as_json:
        print_json(entries)
    else:
        print_lines(*(line for entry in entries for line in target_lines(entry)))
