"""Commands that take a terrain to a program, and that tell which programs there are."""

from __future__ import annotations

from sketchterrain.app import arguments as given
from sketchterrain.app.arguments import read_sketch
from sketchterrain.app.commands import target_options as asked
from sketchterrain.app.listings import exported_lines, print_json, print_lines, target_entry, target_lines
from sketchterrain.app.progress import Stages


def export(
    sketch: given.SketchName,
    target: asked.TargetName,
    output: given.Folder,
    size: asked.WholeSize = None,
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
    plants: asked.Plants = True,
    grass: asked.GrassToo = False,
    seed: given.Seed = None,
    device: given.DeviceName = None,
    fast: given.Fast = False,
    as_json: given.AsJson = False,
) -> None:
    """Take a terrain to an engine, a GIS or a plain format: the right size, the right way up."""
    options = asked.export_options(
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
        document = read_sketch(sketch, seed, stages)
        with stages.stage("program", "Loading the program"):
            from sketchterrain.app import export as whole
        done = whole.export(document, output, target, options, device=device, fast=fast, stages=stages)
    if as_json:
        print_json(
            done.report | {"folder": str(output), "timings": stages.seconds | {"total": stages.elapsed}}
        )
    else:
        print_lines(*exported_lines(done.report, output, stages.elapsed))


def targets(as_json: given.AsJson = False) -> None:
    """List where a terrain can be taken: sizes, formats, options, and what must be installed."""
    from sketchterrain.export.targets import TARGET_NAMES, target_named

    entries = [target_entry(target_named(name)) for name in TARGET_NAMES]
    if as_json:
        print_json(entries)
    else:
        print_lines(*(line for entry in entries for line in target_lines(entry)))
