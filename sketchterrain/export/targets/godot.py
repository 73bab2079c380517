"""Godot with Terrain3D: heights in metres at 1 m a pixel, its control map, plants and water."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes, path_of, tiles_of, write_all_plants, write_all_water
from sketchterrain.export.files import write_values_png
from sketchterrain.export.height_steps import HeightSteps
from sketchterrain.export.rasters import write_exr
from sketchterrain.export.sampled import Grid, Sampled
from sketchterrain.export.target import Export, ExportOptions, Target, Written
from sketchterrain.export.tiling import Piece, Tiling
from sketchterrain.export.weights import control_map, four_of
from sketchterrain.whole_files import write_atomic

_REGION: Final = 256  # vertices along a region's side unless a larger one is chosen
_REGIONS: Final = 32  # each way, at most
_MOST: Final = 16384  # vertices along a side that the importer takes
# The largest region size that so many need: a region that is only begun would lie flat at 0 m.
_MULTIPLE: Final = _MOST // _REGIONS
_FILES: Final = {
    "exr": "heights, m: float32",
    "r16": "heights: 16 bits, little-endian, no header",
    "control": "control map: the two heaviest materials of each vertex as bits of Terrain3D",
    "weights": "weights of four materials: red, green, blue, alpha",
    "normal": "normals, Y+: red east, green north, blue up",
}


def region_size(grid: Grid) -> int:
    """Return the smallest region size, from Terrain3D's own 256 on, of which 32 cover the grid each way."""
    size, longer = _REGION, max(grid.columns, grid.rows)
    while size * _REGIONS < longer:
        size *= 2
    return size


def import_position(grid: Grid) -> tuple[int, int]:
    """Return where the north-west vertex comes to lie, x and z in m: the terrain is about the world's origin.

    It is a whole multiple of the region size, to which versions up to 1.0 round it.
    """
    region = region_size(grid)
    x, z = (-region * (vertices // 2 // region) for vertices in (grid.columns, grid.rows))
    return x, z


def godot_axes(grid: Grid) -> EngineAxes:
    """Return Godot's axes, with its origin where :func:`import_position` makes it lie."""
    x, z = import_position(grid)
    return EngineAxes("east", "up", "south", origin=(grid.west - x, grid.north + z, 0.0))


def write_godot(export: Export) -> Written:
    """Write what the importer of Terrain3D takes ("Importing & Exporting Data" in its documentation).

    An image's first row is the north edge: z grows southward. EXR images have the one channel R, as
    Terrain3D's own exports have; heights are metres. Numbers of r16 are read as
    minimum + number / 65535 · (maximum − minimum).
    """
    steps = _steps(export)
    axes = godot_axes(export.grid)
    files: dict[Path, str] = {}
    with export.stages.stage("godot", "Heights and control map") as tell:
        for done, (piece, tile) in enumerate(tiles_of(export), start=1):
            files |= _images(export, piece, tile, steps)
            tell(done / export.tiling.count)
    files |= write_all_plants(export, axes) | write_all_water(export, axes)
    facts: dict[str, Any] = {
        "heights": {"numbers": "float32", "channel": "R", "metres": "value"},
        "axes": axes.facts,
        "textures": dict(enumerate(export.terrain.material_names)),
    }
    if steps is not None:
        facts |= {"heights": {"numbers": "uint16", **steps.facts}, "byte_order": "little-endian"}
    return Written(files, _settings(export, steps), facts)


def _steps(export: Export) -> HeightSteps | None:
    if export.options.format != "r16":
        return None
    return HeightSteps.of(export.sampled.height, export.options.heights)


def _images(export: Export, piece: Piece, tile: Sampled, steps: HeightSteps | None) -> dict[Path, str]:
    files = {_write_heights(export, piece, tile, steps): _FILES["exr" if steps is None else "r16"]}
    control = path_of(export, "control", piece, ".exr")
    files[write_exr(control, {"R": control_map(tile.weights)})] = _FILES["control"]
    normal = path_of(export, "normal", piece, ".png")
    files[write_values_png(normal, tile.normal)] = _FILES["normal"]
    for number, first in enumerate(range(0, tile.weights.shape[-1], 4), start=1):
        path = path_of(export, f"weights{number}", piece, ".png")
        files[write_values_png(path, four_of(tile.weights, first))] = _FILES["weights"]
    return files


def _write_heights(export: Export, piece: Piece, tile: Sampled, steps: HeightSteps | None) -> Path:
    if steps is None:
        return write_exr(path_of(export, "height", piece, ".exr"), {"R": tile.height})
    numbers = steps.encode(tile.height).astype("<u2")
    return write_atomic(path_of(export, "height", piece, ".r16"), numbers.tobytes())


def _settings(export: Export, steps: HeightSteps | None) -> dict[str, Any]:
    pieces = list(export.tiling.pieces(export.grid.columns, export.grid.rows))
    ending, r16 = ".exr", dict[str, Any]()
    if steps is not None:
        size = {"x": pieces[0].columns, "y": pieces[0].rows}
        ending, r16 = ".r16", {"r16_range": {"x": steps.low, "y": steps.highest}, "r16_size": size}
    x, z = import_position(export.grid)
    return {
        "where": "addons/terrain_3d/tools/importer.tscn",
        "region_size": region_size(export.grid),
        "vertex_spacing": 1.0,
        "import_scale": 1.0,
        "height_offset": 0.0,
        **r16,
        "tiles": [
            {
                "height_file_name": path_of(export, "height", piece, ending).name,
                "control_file_name": path_of(export, "control", piece, ".exr").name,
                "import_position": {"x": x + piece.left, "y": z + piece.top},
            }
            for piece in pieces
        ],
    }


def _check(options: ExportOptions) -> None:
    if options.heights is not None and options.format != "r16":
        raise InputError("godot: a range of heights is for the format r16, EXR has metres")


TARGETS: Final = (
    Target(
        name="godot",
        title="Godot, Terrain3D",
        line="EXR or r16 heights at 1 m a pixel, control map, plants, water",
        write=write_godot,
        spacing=1.0,
        multiple=_MULTIPLE,
        most=_MOST,
        formats=("exr", "r16"),
        knows=frozenset({"tiles", "tile_name", "tile_first", "tiles_from_south", "format", "heights"}),
        tiling=Tiling(overlap=0),
        check=_check,
        disk=24.0,
        memory=16.0,
        bytes_per_plant=100.0,
    ),
)
