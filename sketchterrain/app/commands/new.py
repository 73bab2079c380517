"""Command `new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sketchterrain.app import arguments as args
from sketchterrain.app.console import USAGE_ERROR, Stages
from sketchterrain.app.listings import pluralize, print_lines

_Dems = Annotated[
    list[Path] | None,
    typer.Option(
        "--dem",
        metavar="FILE",
        help="Elevation beneath the sketch: GeoTIFF, VRT, HGT, ASC, NumPy, zip; repeatable, or a folder.",
    ),
]
_Extent = Annotated[
    float | None,
    typer.Option(
        "--extent", metavar="M", min=1.0, help="Longer side in the middle of --dem; by default all."
    ),
]


def new(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A new or an empty folder; with --dem also a .sketch file.")
    ],
    dem: _Dems = None,
    extent: _Extent = None,
    crs: args.Crs = None,
    origin: args.Origin = None,
    vertical: args.VerticalDatum = None,
    raster: args.Rasters = None,
    embed: args.Embed = False,
) -> None:
    """Write a starter sketch to paint on, or with --dem an empty one on real elevation."""
    from sketchterrain.document.store import new_sketch

    if embed and not (raster or dem):
        raise USAGE_ERROR("--embed without --raster or --dem: expected a raster to store")
    if extent is not None and not dem:
        raise USAGE_ERROR("--extent without --dem: expected elevation to be so large a part of")
    east, north = origin or (0.0, 0.0)
    frame = {"crs": crs or "", "east": east, "north": north, "vertical": vertical or ""}
    sources, area = args.read_rasters(raster or (), embed=embed)
    if dem:
        with Stages() as stages, stages.stage("elevation", "Reading elevation"):
            from sketchterrain.document.rasters import raster_source
            from sketchterrain.document.store import save_new
            from sketchterrain.importing.elevation import elevation_files, sketch_on_elevation

            grids = [raster_source(path, "elevation", embed=embed) for path in elevation_files(dem)]
            made = sketch_on_elevation(grids, crs=crs, origin=origin, extent=extent, vertical=vertical or "")
            save_new(made.sketch.replace(rasters=(*made.sketch.rasters, *sources)), folder)
        width, depth = (side / 1000.0 for side in made.sketch.size)
        print_lines(
            f"wrote a sketch of {width:.4g} × {depth:.4g} km on {pluralize(len(made.base.grids), 'grid')} of "
            f"elevation to {folder}:",
            *(f"note: {line}" for line in made.findings),
            f"sketchterrain generate {folder} -o out",
        )
        return
    if area is None or crs is not None or origin is not None:
        new_sketch(folder, frame=frame, rasters=sources)
    else:
        new_sketch(folder, frame=frame | area.frame, size=area.size, rasters=sources)
    print_lines(
        f"wrote a starter sketch to {folder}: paint its PNGs, read its sketch.toml, then run",
        f"sketchterrain generate {folder} -o out",
    )
