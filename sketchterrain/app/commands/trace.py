"""Commands `new` and `trace`: sketches to start from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain.app import arguments as args
from sketchterrain.app.listings import print_json, print_lines
from sketchterrain.io.console import USAGE_ERROR, Stages, pluralize

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from sketchterrain.document.sketch import Sketch
    from sketchterrain.importing.traced_layers import TraceOptions, TraceResult


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


# Options for certain kinds of sources only.
_KINDS_OF_OPTION = {
    **dict.fromkeys(("--colour", "--colours", "--tolerance", "--specks", "--rivers-up-to"), ("picture",)),
    "--layer": ("picture", "vectors"),
    **dict.fromkeys(("--width", "--bounds", "--crs"), ("vectors",)),
    "--extent": ("picture", "folder", "open raster"),
}
_KINDS = {
    "picture": "a picture",
    "folder": "a folder of pictures",
    "open raster": "an OpenRaster file",
    "vectors": "vectors",
}


def trace(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A coloured map (PNG, JPEG, TIFF, WebP), layers (.ora, a folder of pictures), "
            "vectors (GeoJSON, GeoPackage, FlatGeobuf, Shapefile, GPX, KML, DXF, OpenStreetMap).",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR|FILE.sketch", help="A new sketch.")],
    extent: Annotated[float | None, typer.Option(metavar="M", help="Metres along the longer side.")] = None,
    size: Annotated[
        int | None,
        typer.Option(
            metavar="PX", help="Pixels along the longer side; default: the picture's, at most 1024."
        ),
    ] = None,
    colour: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LAYER=#rrggbb",
            help="Meaning of a colour: river=#0000ff, river.2=#3060ff, nothing=#ffffff, ink=#000000.",
        ),
    ] = None,
    colours: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Legend: tables [[colour]] of rgb, layer, label.")
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(metavar="T", min=0.0, max=1.0, help="Distance from the legend's colours, Oklab; 0.1."),
    ] = None,
    specks: Annotated[
        int | None, typer.Option(metavar="PX", min=0, help="Removes areas of fewer pixels; default 16.")
    ] = None,
    rivers_up_to: Annotated[
        float | None, typer.Option(metavar="PX", min=1.0, help="Widest water that is a river, not a lake.")
    ] = None,
    layer: Annotated[
        str | None, typer.Option(metavar="NAME", help="Layer of all that is painted, or of untagged vectors.")
    ] = None,
    width: Annotated[
        float | None, typer.Option(metavar="M", min=0.0, help="Default width of lines of vectors.")
    ] = None,
    bounds: args.SourceBounds = None,
    crs: Annotated[
        str | None, typer.Option(metavar="CRS", help="CRS to reproject vectors to, as EPSG:32633.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the sketch; default: the file's.")] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", help="Seed of the sketch; default 0.")] = None,
    preview: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Picture of the sketch beside its source.")
    ] = None,
    as_json: args.AsJson = False,
) -> None:
    """Trace a sketch from a coloured map, a paint program's layers, or GIS vectors."""
    if preview is not None and preview.suffix.lower() != ".png":
        raise USAGE_ERROR(f"--preview: expected the name of a .png file, got {str(preview)!r}")
    if colour and colours is not None:
        raise USAGE_ERROR("--colours with --colour: expected one legend")
    coloured = {"--colour": colour, "--colours": colours, "--tolerance": tolerance, "--specks": specks}
    coloured["--rivers-up-to"] = rivers_up_to
    mapped = {"--width": width, "--bounds": bounds, "--crs": crs}
    with Stages() as stages:
        with stages.stage("program", "Loading the program"):
            from sketchterrain.document.store import save_sketch
            from sketchterrain.importing.images import detect_kind
            from sketchterrain.importing.traced_layers import TraceOptions

            kind = detect_kind(file)
            _reject_options(kind, {**coloured, **mapped, "--layer": layer, "--extent": extent})
            if kind == "picture" and layer is not None:
                unsupported = [option for option, value in coloured.items() if value not in (None, [])]
                if unsupported:
                    raise USAGE_ERROR(
                        f"{unsupported[0]}: not with --layer, which is the layer of all that is painted"
                    )
            _check_places(file, output, preview)
            options = TraceOptions(size_px=size, extent=extent, name=name, seed=seed or 0)
        source: npt.NDArray[np.uint8] | None = None
        with stages.stage("trace", f"Tracing {_KINDS[kind]}"):
            if kind == "picture" and layer is None:
                from sketchterrain.importing.images import SPECKS

                done, source = _from_map(
                    *(file, options, colour, colours, tolerance),
                    specks=SPECKS if specks is None else specks,
                    narrow=rivers_up_to or 0.0,
                )
            elif kind == "vectors":
                done = _from_vectors(file, options, layer=layer, width=width, bounds=bounds, crs=crs)
            else:
                from sketchterrain.importing.layered import trace_folder, trace_mask, trace_open_raster

                trace_layers = trace_folder if kind == "folder" else trace_open_raster
                done = trace_layers(file, options) if layer is None else trace_mask(file, layer, options)
        with stages.stage("files", "Writing files"):
            save_sketch(done.sketch, output)
            if preview is not None:
                from sketchterrain.importing.traced_layers import preview_png
                from sketchterrain.io.files import write_atomic

                write_atomic(preview, preview_png(done.sketch, source))
    if as_json:
        print_json(_entry(done, output, kind))
    else:
        print_lines(*done.notes, f"sketch: {output}")
        if preview is not None:
            print_lines(f"picture: {preview}")


def _reject_options(kind: str, values: dict[str, object]) -> None:
    for option, value in values.items():
        if value not in (None, []) and kind not in _KINDS_OF_OPTION[option]:
            kinds = " or ".join(_KINDS[kind] for kind in _KINDS_OF_OPTION[option])
            raise USAGE_ERROR(f"{option}: not with {_KINDS[kind]}, only with {kinds}")


def _check_places(file: Path, output: Path, preview: Path | None) -> None:
    from sketchterrain.document.store import reject_sketch_folder
    from sketchterrain.errors import InputError, one_line
    from sketchterrain.io.files import wrap_os_errors

    place = one_line(output)
    with wrap_os_errors(output):
        if output.is_dir() and any(output.iterdir()):
            raise InputError(f"{place}: expected a new or an empty folder, this one is not empty")
        if output.exists() and not output.is_dir():
            raise InputError(f"{place}: expected a new folder or .sketch file, this one exists")
        if preview is None:
            return
        reject_sketch_folder(preview.parent)
        if not preview.parent.is_dir():
            raise InputError(f"{one_line(preview)}: expected a file in an existing folder")
        path = preview.resolve()
        for other in (file, output):  # the preview must not overwrite the source or the sketch
            if other.resolve() in (path, *path.parents):
                raise InputError(f"{one_line(preview)}: expected another place than {one_line(other)}")


def _from_map(
    file: Path,
    options: TraceOptions,
    colour: list[str] | None,
    colours: Path | None,
    tolerance: float | None,
    **settings: Any,
) -> tuple[TraceResult, npt.NDArray[np.uint8]]:
    from sketchterrain.importing.images import read_map
    from sketchterrain.importing.legend import OWN_LEGEND, TOLERANCE, Legend, read_legend

    distance = TOLERANCE if tolerance is None else tolerance
    if colours is not None:
        legend = read_legend(colours, tolerance=distance)
    elif colour:
        legend = Legend.parse(colour, tolerance=distance)
    else:
        legend = OWN_LEGEND if tolerance is None else Legend(OWN_LEGEND.colours, distance)
    image = read_map(file, legend)
    return image.traced(options, **settings), image.rgba


def _from_vectors(file: Path, options: TraceOptions, **settings: Any) -> TraceResult:
    from dataclasses import replace

    from sketchterrain.document.sketch import DEFAULT_SIDE
    from sketchterrain.importing.vectors import sketch_from_vectors

    side = DEFAULT_SIDE if options.size_px is None else options.size_px
    traced = sketch_from_vectors(file, name=options.name, size_px=side, **settings)
    return replace(traced, sketch=traced.sketch.replace(seed=options.seed))


def _entry(done: TraceResult, output: Path, kind: str) -> dict[str, Any]:
    from sketchterrain.document.label_layers import labels_in
    from sketchterrain.importing.images import TracedMap

    sketch: Sketch = done.sketch
    entry: dict[str, Any] = {
        "sketch": str(output),
        "kind": kind,
        "name": sketch.name,
        "extent": sketch.extent,
        "seed": sketch.seed,
        "size": {"width": sketch.width_px, "height": sketch.height_px},
        "layers": {name: labels_in(image) for name, image in sketch.layers.items() if image.any()},
        "vectors": {name: len(layer) for name, layer in sketch.vectors.items() if layer},
        "notes": done.notes,
    }
    if isinstance(done, TracedMap):
        entry["shares"] = {"sure": done.certain, "taken": done.inferred, "unknown": done.unknown}
        entry["colours"] = [
            {"rgb": colour.code, "share": colour.share, "layer": meaning and meaning.layer}
            | ({"label": meaning.label} if meaning is not None and meaning.label else {})
            for colour, meaning in done.colours
        ]
    return entry
