"""What can be asked of an export, as words of a command line.

A text that cannot be meant raises ``typer.BadParameter``, a usage error.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sketchterrain.app.arguments import reject_combination

if TYPE_CHECKING:
    from sketchterrain.export.target import ExportOptions

# As in sketchterrain.export.targets, which is not loaded for a line of help; a test compares them.
TARGETS = (
    "unity",
    "unreal",
    "godot",
    "blender",
    "gltf",
    "geotiff",
    "raw",
    "png16",
    "exr",
    "npy",
    "obj",
    "stl",
)


def _check_target(name: str) -> str:
    if name not in TARGETS:
        raise typer.BadParameter(f"expected one of {', '.join(TARGETS)}, got {name!r}")
    return name


def _parse_tiles(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"([1-9]\d{0,4})[x×]([1-9]\d{0,4})", text.strip())
    if match is None:
        raise typer.BadParameter(f"expected COLUMNSxROWS of tiles, as 4x4, got {text!r}")
    return int(match[1]), int(match[2])


def _parse_pair(text: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        first = second = math.nan
    if not (math.isfinite(first) and math.isfinite(second)):
        raise typer.BadParameter(f"expected two numbers with a comma between them, got {text!r}")
    return first, second


TargetName = Annotated[
    str,
    typer.Option(
        "--to",
        metavar="TARGET",
        callback=_check_target,
        help=f"Where it is taken: {', '.join(TARGETS)}; `targets` tells more of each.",
    ),
]
WholeSize = Annotated[
    int | None,
    typer.Option(
        "--size",
        metavar="N",
        min=2,
        help="Vertices along the longer side, of all tiles; as suits the target.",
    ),
]
Tiles = Annotated[
    Any, typer.Option("--tiles", parser=_parse_tiles, metavar="CxR", help="Columns and rows of tiles.")
]
Overlap = Annotated[
    int | None,
    typer.Option(metavar="N", min=0, help="Vertices that neighbouring tiles share: 1 is an edge, 0 nothing."),
]
TileName = Annotated[
    str | None,
    typer.Option("--tile-name", metavar="PATTERN", help="As {name}_x{x}_y{y}; {x:02} has leading zeros."),
]
TileFirst = Annotated[
    int | None, typer.Option("--tile-first", metavar="N", min=0, help="Number of the first tile each way.")
]
TilesFromSouth = Annotated[
    bool | None,
    typer.Option("--tiles-from-south/--tiles-from-north", help="Which row of tiles has the first number."),
]
Format = Annotated[
    str | None, typer.Option("--format", metavar="NAME", help="Of heights, where a target has several.")
]
Heights = Annotated[
    Any,
    typer.Option(
        "--heights",
        parser=_parse_pair,
        metavar="LOW,HIGH",
        help="Metres of 16-bit numbers, to be the same for many terrains; else as fine as may be.",
    ),
]
MeshError = Annotated[
    float | None,
    typer.Option("--error", metavar="M", help="Metres that a mesh may be off; else it has all vertices."),
]
Crs = Annotated[
    str | None,
    typer.Option("--crs", metavar="CRS", help="Coordinate reference system in metres, as EPSG:25832."),
]
Origin = Annotated[
    Any,
    typer.Option(
        "--origin", parser=_parse_pair, metavar="E,N", help="Where the sketch's south-west corner lies in it."
    ),
]
Plants = Annotated[bool, typer.Option("--plants/--no-plants", help="Write trees and shrubs.")]
GrassToo = Annotated[bool, typer.Option("--grass", help="Grass, flowers and ferns too: many.")]


def export_options(
    *,
    size: int | None = None,
    tiles: tuple[int, int] | None = None,
    overlap: int | None = None,
    tile_name: str | None = None,
    tile_first: int | None = None,
    tiles_from_south: bool | None = None,
    form: str | None = None,
    heights: tuple[float, float] | None = None,
    error: float | None = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    plants: bool = True,
    grass: bool = False,
) -> ExportOptions:
    """Return what was asked for on a command line; what is None is as usual."""
    from sketchterrain.export.target import ExportOptions

    if tiles is None or tiles == (1, 1):
        of_tiles: dict[str, object] = {"--overlap": overlap, "--tile-name": tile_name}
        of_tiles |= {"--tile-first": tile_first, "--tiles-from-south": tiles_from_south}
        reject_combination("no --tiles", of_tiles, "there is one tile")
    return ExportOptions(
        size=size,
        tiles=tiles or (1, 1),
        overlap=overlap,
        tile_name=tile_name,
        tile_first=tile_first,
        tiles_from_south=tiles_from_south,
        format=form,
        heights=heights,
        error=error,
        crs=crs,
        origin=origin or (0.0, 0.0),
        plants=plants,
        grass=grass,
    )
