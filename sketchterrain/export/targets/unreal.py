"""Unreal Engine landscapes: 16-bit heights, a weight map per layer, Y− normals, plants and water."""

from functools import partial
from pathlib import Path
from typing import Any, Final

from sketchterrain.export.engines import EngineAxes, tile_path, write_plants_json, write_tiles
from sketchterrain.export.files import write_values_png
from sketchterrain.export.planning import HeightQuantisation
from sketchterrain.export.rasters import write_raw
from sketchterrain.export.roads import write_corridors
from sketchterrain.export.sampled import TerrainSamples, flip_green
from sketchterrain.export.target import NAMED_TILES, Export, ExportOutput, Target, TileWindow, Tiling

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


def _write_unreal(export: Export) -> ExportOutput:
    """Write the files of Unreal's landscapes.

    A landscape's first row is its north edge, as its y axis points south. Number 32768 is the landscape's own
    height, and 128 steps are its Z scale in centimetres ("Landscape Technical Guide": ±256 m at a scale of
    100); so the Z scale is the range in m · 100 / 512.
    """
    steps = HeightQuantisation.from_heights(export.samples.height, export.options.heights)
    corner = (export.grid.west, export.grid.north, 0.0)  # north-west, at the landscape's origin
    axes = EngineAxes("east", "south", "up", unit="cm", per_metre=_CENTIMETRES, origin=corner)
    files = write_tiles(export, "unreal", "Heights and weight maps", partial(_write_images, export, steps))
    files |= write_plants_json(export, axes, degrees=True) | write_corridors(export, axes)
    facts = {
        "heights": steps.metadata,
        "byte_order": "little-endian" if export.options.format == "r16" else "as PNG has it",
        "axes": axes.metadata,
        "layers": list(export.terrain.material_names),
    }
    return ExportOutput(files, _settings(export, steps), facts)


def _write_images(
    export: Export, steps: HeightQuantisation, tile: TileWindow, samples: TerrainSamples
) -> dict[Path, str]:
    numbers = steps.encode(samples.height)
    if export.options.format == "r16":
        heights = write_raw(tile_path(export, "height", tile, ".r16"), numbers, "<u2")
    else:
        heights = write_values_png(tile_path(export, "height", tile, ".png"), numbers)
    files = {heights: _FILES[export.options.format or "png"]}
    normal = tile_path(export, "normal", tile, ".png")
    files[write_values_png(normal, flip_green(samples.normal))] = _FILES["normal"]
    for index, name in enumerate(export.terrain.material_names):
        path = tile_path(export, f"weight_{name}", tile, ".png")
        files[write_values_png(path, samples.weights[..., index])] = f"weights of {name}: 255 is all of it"
    return files


def _settings(export: Export, steps: HeightQuantisation) -> dict[str, Any]:
    dx, dy = export.grid.spacing
    tiling = export.tiling
    first = next(tiling.tiles(export.grid.columns, export.grid.rows))
    quads = _SECTION_QUADS[first.columns]
    components = (first.columns - 1) // (quads * _SECTIONS)
    settings: dict[str, Any] = {
        "Heightmap File": tile_path(export, "height", first, f".{export.options.format}").name,
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
        "Location is": "the Landscape actor's, its north-west corner: set it after the import",
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
        summary="16-bit PNG or r16 heights, a weight map a layer, normals Y−, plants, water",
        write=_write_unreal,
        sizes=tuple(_SECTION_QUADS),
        size=1009,
        square=True,
        formats=("png", "r16"),
        options=NAMED_TILES | {"overlap", "format", "heights"},
        tiling=Tiling(pattern="{name}_x{x}_y{y}"),
        memory=18.0,
    ),
)
