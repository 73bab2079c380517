"""Command `new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sketchterrain.app import arguments as args
from sketchterrain.app.listings import print_lines
from sketchterrain.io.console import USAGE_ERROR, Stages, pluralize


def new(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A new or an empty folder, or a new .sketch file.")
    ],
    dem: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Elevation beneath the sketch; repeatable, or a folder of files."),
    ] = None,
    osm: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Roads, buildings, waters, land use inside of --dem: OpenStreetMap, other vectors.",
        ),
    ] = None,
    extent: Annotated[
        float | None,
        typer.Option(metavar="M", min=1.0, help="Longer side of a part of --dem; default: all."),
    ] = None,
    align: Annotated[
        bool, typer.Option("--align", help="Remove height offsets between overlapping files of --dem.")
    ] = False,
    lakes: Annotated[
        bool, typer.Option("--lakes", help="Add lakes where --dem is level, as vectors.")
    ] = False,
    units: Annotated[str | None, typer.Option(metavar="UNIT", help="Unit of --dem, as us-ft.")] = None,
    signed: Annotated[bool, typer.Option("--signed", help="Numbers of --dem are signed.")] = False,
    cell: Annotated[float | None, typer.Option(metavar="M", help="Cells of --dem without a place.")] = None,
    heights: Annotated[
        str | None,
        typer.Option("--range", metavar="LOW,HIGH", help="Heights (m) that all numbers of --dem span."),
    ] = None,
    encoding: Annotated[str | None, typer.Option(help="Of --dem: mapbox, terrarium, big-endian.")] = None,
    columns: Annotated[int | None, typer.Option(metavar="N", help="Columns of .raw, if not square.")] = None,
    crs: args.Crs = None,
    origin: args.Origin = None,
    vertical: Annotated[
        str | None, typer.Option(metavar="CODE", help="Vertical datum, as EPSG:5773.")
    ] = None,
    raster: Annotated[
        list[str] | None,
        typer.Option(metavar="ROLE=FILE", help="A raster source, as picture=map.tif; repeatable."),
    ] = None,
    embed: Annotated[
        bool, typer.Option("--embed", help="Store copies of the rasters in the sketch.")
    ] = False,
) -> None:
    """Write a starter sketch, or with --dem an empty one on real elevation."""
    from sketchterrain.document.rasters import raster_source
    from sketchterrain.document.store import new_sketch
    from sketchterrain.document.toml_format import starter_sketch

    if embed and not (raster or dem):
        raise USAGE_ERROR("--embed without --raster or --dem: expected a raster to store")
    if osm is not None and not dem:
        raise USAGE_ERROR("--osm without --dem: expected elevation; `trace FILE -o DIR` takes vectors alone")
    stated = {"units": units, "signed": int(signed), "cell": cell, "range": heights}
    stated |= {"encoding": encoding, "columns": columns}
    for name, value in (("extent", extent), ("align", align), ("lakes", lakes), *stated.items()):
        if value and not dem:
            raise USAGE_ERROR(f"--{name} without --dem: expected elevation")
    sources, area = args.read_rasters(raster or (), embed=embed)
    if dem:
        with Stages() as stages, stages.stage("elevation", "Reading elevation"):
            from sketchterrain.importing.elevation import (
                aligned,
                elevation_files,
                sketch_on_elevation,
                with_lakes,
            )

            paths = [path for each in dem for path in elevation_files(each)]
            given = {name: value for name, value in stated.items() if value}
            grids = [raster_source(path, "elevation", embed=embed, **given) for path in paths]
            degrees, traced = None, tuple[str, ...]()
            if osm is not None:
                from sketchterrain.importing.vector_files import osm_bounds
                from sketchterrain.importing.vectors import with_vectors_of

                degrees = None if origin or extent else osm_bounds(osm)
            sketch, base = sketch_on_elevation(
                grids, crs=crs, origin=origin, extent=extent, vertical=vertical or "", degrees=degrees
            )
            if osm is not None:
                sketch, traced = with_vectors_of(sketch, osm)
            sketch, found = with_lakes(sketch) if lakes else (sketch, ())
            sketch = aligned(sketch) if align else sketch
            new_sketch(folder, sketch.replace(rasters=(*sketch.rasters, *sources)))
        width, depth = (side / 1000.0 for side in sketch.size)
        what = f"sketch of {width:.4g} × {depth:.4g} km on {pluralize(len(base.grids), 'grid')} of elevation"
        lines = [f"note: {line}" for line in (*base.findings, *found, *traced)]
    else:
        size, lines, what = None, [], "starter sketch"
        east, north = origin or (0.0, 0.0)
        frame = {"crs": crs or "", "east": east, "north": north, "vertical": vertical or ""}
        if area is not None and crs is None and origin is None:
            frame, size = frame | area.frame, area.size
        new_sketch(folder, starter_sketch(size).replace(frame=frame, rasters=sources))
    print_lines(
        *lines,
        f"wrote a {what} to {folder}: paint its PNGs, read its sketch.toml, then run",
        f"sketchterrain generate {folder} -o out",
    )
