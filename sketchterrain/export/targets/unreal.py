"""Unreal Engine: 16-bit heights, a weight map a layer, normals Y−, plants and water for its landscapes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.export.engines import EngineAxes, path_of, tiles_of, write_all_plants, write_all_water
from sketchterrain.export.files import write_values_png
from sketchterrain.export.height_steps import HeightSteps
from sketchterrain.export.sampled import Sampled
from sketchterrain.export.target import Export, Target, Written
from sketchterrain.export.tiling import Piece, Tiling
from sketchterrain.export.weights import normals_down
from sketchterrain.whole_files import write_atomic

_CENTIMETRES: Final = 100.0
_DECIMALS: Final = 6  # of centimetres
# Quads along a section's side, for the sizes that Epic's "Landscape Technical Guide" recommends; all of them
# have 2 × 2 sections a component.
_SECTION_QUADS: Final = {127: 63, 253: 63, 505: 63, 1009: 63, 2017: 63, 4033: 63, 8129: 127}
_SECTIONS: Final = 2
_FILES: Final = {
    "png": "heights: 16-bit grey",
    "r16": "heights: 16 bits, little-endian, no header",
    "normal": "normals, Y−: red east, green south, blue up",
}


def unreal_axes(export: Export) -> EngineAxes:
    """Return Unreal's axes, with the north-west corner of the landscape at the origin."""
    origin = (export.grid.west, export.grid.north, 0.0)
    return EngineAxes("east", "south", "up", unit="cm", per_metre=_CENTIMETRES, origin=origin)


def write_unreal(export: Export) -> Written:
    """Write what Unreal's landscapes take.

    A landscape's first row is its north edge, for its y axis points south. Number 32768 is its own height,
    and 128 steps are as many centimetres as its Z scale ("Landscape Technical Guide": ±256 m at a scale of
    100); so the Z scale is the range in m · 100 / 512.
    """
    steps = HeightSteps.of(export.sampled.height, export.options.heights)
    axes = unreal_axes(export)
    files: dict[Path, str] = {}
    with export.stages.stage("unreal", "Heights and weight maps") as tell:
        for done, (piece, tile) in enumerate(tiles_of(export), start=1):
            files |= _images(export, piece, tile, steps)
            tell(done / export.tiling.count)
    files |= write_all_plants(export, axes, degrees=True) | write_all_water(export, axes)
    facts = {
        "heights": {"numbers": "uint16", **steps.facts},
        "byte_order": "little-endian" if export.options.format == "r16" else "as PNG has it",
        "axes": axes.facts,
        "layers": list(export.terrain.material_names),
    }
    return Written(files, _settings(export, steps), facts)


def _images(export: Export, piece: Piece, tile: Sampled, steps: HeightSteps) -> dict[Path, str]:
    files = {_write_heights(export, piece, steps.encode(tile.height)): _FILES[export.options.format or "png"]}
    normal = path_of(export, "normal", piece, ".png")
    files[write_values_png(normal, normals_down(tile.normal))] = _FILES["normal"]
    for index, name in enumerate(export.terrain.material_names):
        path = path_of(export, f"weight_{name}", piece, ".png")
        files[write_values_png(path, tile.weights[..., index])] = f"weights of {name}: 255 is all of it"
    return files


def _write_heights(export: Export, piece: Piece, numbers: npt.NDArray[np.uint16]) -> Path:
    if export.options.format == "r16":
        return write_atomic(path_of(export, "height", piece, ".r16"), numbers.astype("<u2").tobytes())
    return write_values_png(path_of(export, "height", piece, ".png"), numbers)


def _settings(export: Export, steps: HeightSteps) -> dict[str, Any]:
    dx, dy = export.grid.spacing
    tiling = export.tiling
    pieces = tiling.pieces(export.grid.columns, export.grid.rows)
    first = next(pieces)
    quads = _SECTION_QUADS[first.columns]
    components = (first.columns - 1) // (quads * _SECTIONS)
    settings: dict[str, Any] = {
        "Heightmap File": path_of(export, "height", first, f".{export.options.format}").name,
        "Scale": {
            "X": dx * _CENTIMETRES,
            "Y": dy * _CENTIMETRES,
            "Z": steps.range * _CENTIMETRES / 512.0,
        },
        "Location": {
            "X": 0.0,
            "Y": 0.0,
            "Z": round((steps.low + steps.range / 2.0) * _CENTIMETRES, _DECIMALS),
        },
        "Location is": "the Landscape actor's, its north-west corner: to be set once it is there",
        "Section Size": f"{quads}x{quads} Quads",
        "Sections Per Component": f"{_SECTIONS}x{_SECTIONS} Sections",
        "Number of Components": {"X": components, "Y": components},
        "Overall Resolution": {"X": first.columns, "Y": first.rows},
    }
    if tiling.count > 1:
        settings["Flip Tile Y Coordinate"] = tiling.from_south
        if not tiling.from_south:
            settings["Tile Coordinates Offset"] = {"X": -tiling.first, "Y": -tiling.first}
        settings["tiles"] = "components and resolution are those of one tile"
    return settings


TARGETS: Final = (
    Target(
        name="unreal",
        title="Unreal Engine",
        line="16-bit PNG or r16 heights, a weight map a layer, normals Y−, plants, water",
        write=write_unreal,
        sizes=tuple(_SECTION_QUADS),
        size=1009,
        square=True,
        formats=("png", "r16"),
        knows=frozenset(
            {"tiles", "overlap", "tile_name", "tile_first", "tiles_from_south", "format", "heights"}
        ),
        tiling=Tiling(pattern="{name}_x{x}_y{y}"),
        disk=16.0,
        memory=18.0,
        bytes_per_plant=100.0,
    ),
)
