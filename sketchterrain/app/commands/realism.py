"""Command `realism`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain.app import arguments as args
from sketchterrain.app.listings import print_result
from sketchterrain.io.console import USAGE_ERROR, Stages
from sketchterrain.measure.lines import realism_lines

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.measure.realism import Realism

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
    kinds = tuple(kind or ())
    with Stages() as stages:
        if Path(source).suffix.lower() in _RASTERS:
            if seed is not None or device is not None:
                raise USAGE_ERROR("--seed and --device are for sketches, not for rasters")
            with stages.stage("realism", "Comparing with real land"):
                from sketchterrain.importing.elevation import read_heights
                from sketchterrain.measure.realism import measure_realism

                height, step = read_heights(Path(source), cell)
                found, header = measure_realism(height, step, kinds=kinds), {"file": source}
        else:
            found, header = _measure_sketch(source, cell, size, kinds, seed, device, stages)
    if map_file is not None:
        from sketchterrain.export.measured_maps import write_realism_map

        write_realism_map(map_file, found)
    entry = header | found.as_dict()
    lines = [*realism_lines(entry), *([] if map_file is None else [f"map: {map_file}"])]
    print_result(entry, lines, as_json=as_json)


def _measure_sketch(
    source: str,
    cell: float | None,
    size: int,
    kinds: tuple[str, ...],
    seed: int | None,
    device: str | None,
    stages: Stages,
) -> tuple[Realism, dict[str, Any]]:
    document = args.read_sketch(source, seed, stages)
    with stages.stage("program", "Loading the program"):
        from sketchterrain.jobs.export import DeviceFallback, build_terrain
        from sketchterrain.measure.realism import DEFAULT_CELL, measure_terrain_realism

    def work(context: ComputeContext, _: tuple[str, ...]) -> Realism:
        terrain = build_terrain(document, context, stages, kernels=["points.cl"])
        with stages.stage("realism", "Comparing with real land"):
            return measure_terrain_realism(terrain, cell=cell or DEFAULT_CELL, size=size, kinds=kinds)

    found = DeviceFallback(device).run(work, stages=stages)
    return found, {"sketch": document.name, "seed": document.seed}
