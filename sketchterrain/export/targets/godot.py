"""Godot with Terrain3D: heights in metres at 1 m a pixel, its control map, plants and water."""

from functools import partial
from pathlib import Path
from typing import Any, Final

from sketchterrain.errors import InputError
from sketchterrain.export.engines import EngineAxes, tile_path, write_plants_json, write_tiles
from sketchterrain.export.files import write_values_png
from sketchterrain.export.planning import HeightQuantisation
from sketchterrain.export.rasters import write_exr, write_raw
from sketchterrain.export.roads import write_corridors
from sketchterrain.export.sampled import SampleGrid, TerrainSamples, control_map, rgba_weights
from sketchterrain.export.target import (
    NAMED_TILES,
    Export,
    ExportOptions,
    ExportOutput,
    Target,
    TileWindow,
    Tiling,
)

_REGION: Final = 256  # default vertices along a region's side
_MAX_REGIONS: Final = 32  # along a side
_MAX_VERTICES: Final = 16384  # along a side, of the importer
# The largest region size that so many need: an incomplete region would be flat at 0 m.
_MULTIPLE: Final = _MAX_VERTICES // _MAX_REGIONS
_FILES: Final = {
    "exr": "heights, m: float32",
    "r16": "heights: 16 bits, little-endian, no header",
    "control": "control map: the two heaviest materials of each vertex as bits of Terrain3D",
    "weights": "weights of four materials: red, green, blue, alpha",
    "normal": "normals, Y+: red east, green north, blue up",
}


def region_size(grid: SampleGrid) -> int:
    """Return the smallest region size, from Terrain3D's default 256 on, of which 32 × 32 cover the grid."""
    size, longer = _REGION, max(grid.columns, grid.rows)
    while size * _MAX_REGIONS < longer:
        size *= 2
    return size


def import_position(grid: SampleGrid) -> tuple[int, int]:
    """Return x and z (m) of the north-west vertex, so that the terrain is centred on the world's origin.

    They are multiples of the region size, to which versions up to 1.0 round them.
    """
    region = region_size(grid)
    x, z = (-region * (vertices // 2 // region) for vertices in (grid.columns, grid.rows))
    return x, z


def _write_godot(export: Export) -> ExportOutput:
    """Write the input of Terrain3D's importer ("Importing & Exporting Data" in its documentation).

    An image's first row is the north edge: z grows southward. EXR images have the single channel R, as
    Terrain3D's own exports have; heights are metres. Numbers of r16 are read as
    minimum + number / 65535 · (maximum − minimum).
    """
    steps = None
    if export.options.format == "r16":
        steps = HeightQuantisation.from_heights(export.samples.height, export.options.heights)
    x, z = import_position(export.grid)
    axes = EngineAxes("east", "up", "south", origin=(export.grid.west - x, export.grid.north + z, 0.0))
    files = write_tiles(export, "godot", "Heights and control map", partial(_write_images, export, steps))
    files |= write_plants_json(export, axes) | write_corridors(export, axes)
    facts: dict[str, Any] = {
        "heights": {"numbers": "float32", "channel": "R", "metres": "value"},
        "axes": axes.metadata,
        "textures": dict(enumerate(export.terrain.material_names)),
    }
    if steps is not None:
        facts |= {"heights": steps.metadata, "byte_order": "little-endian"}
    return ExportOutput(files, _settings(export, steps), facts)


def _write_images(
    export: Export, steps: HeightQuantisation | None, tile: TileWindow, samples: TerrainSamples
) -> dict[Path, str]:
    if steps is None:
        path = write_exr(tile_path(export, "height", tile, ".exr"), {"R": samples.height})
    else:
        path = write_raw(tile_path(export, "height", tile, ".r16"), steps.encode(samples.height), "<u2")
    files = {path: _FILES[path.suffix[1:]]}
    control = tile_path(export, "control", tile, ".exr")
    files[write_exr(control, {"R": control_map(samples.weights)})] = _FILES["control"]
    normal = tile_path(export, "normal", tile, ".png")
    files[write_values_png(normal, samples.normal)] = _FILES["normal"]
    for number, first in enumerate(range(0, samples.weights.shape[-1], 4), start=1):
        path = tile_path(export, f"weights{number}", tile, ".png")
        files[write_values_png(path, rgba_weights(samples.weights, first))] = _FILES["weights"]
    return files


def _settings(export: Export, steps: HeightQuantisation | None) -> dict[str, Any]:
    tiles = list(export.tiling.tiles(export.grid.columns, export.grid.rows))
    suffix, r16 = ".exr", dict[str, Any]()
    if steps is not None:
        size = {"x": tiles[0].columns, "y": tiles[0].rows}
        suffix, r16 = ".r16", {"r16_range": {"x": steps.low, "y": steps.highest}, "r16_size": size}
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
                "height_file_name": tile_path(export, "height", tile, suffix).name,
                "control_file_name": tile_path(export, "control", tile, ".exr").name,
                "import_position": {"x": x + tile.left, "y": z + tile.top},
            }
            for tile in tiles
        ],
    }


def _check(options: ExportOptions) -> None:
    if options.heights is not None and options.format != "r16":
        raise InputError("godot: a range of heights is for the format r16, EXR has metres")


TARGETS: Final = (
    Target(
        name="godot",
        title="Godot, Terrain3D",
        summary="EXR or r16 heights at 1 m a pixel, control map, plants, water",
        write=_write_godot,
        spacing=1.0,
        multiple=_MULTIPLE,
        max_vertices=_MAX_VERTICES,
        formats=("exr", "r16"),
        options=NAMED_TILES | {"format", "heights"},
        tiling=Tiling(overlap=0),
        check=_check,
        disk=24.0,
    ),
)
