"""Unity terrains: RAW heights, splat maps, tree instances, water."""

from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.export.engines import (
    EngineAxes,
    requested_storeys,
    tile_path,
    tile_samples,
    write_tiles,
)
from sketchterrain.export.files import format_rows, write_json_list, write_values_png
from sketchterrain.export.foliage_files import plant_chunks
from sketchterrain.export.planning import HeightQuantisation
from sketchterrain.export.rasters import write_raw
from sketchterrain.export.roads import write_corridors
from sketchterrain.export.sampled import (
    CHANNELS,
    TerrainSamples,
    interpolate_heights,
    rgba_weights,
    splat_weights,
)
from sketchterrain.export.target import NAMED_TILES, Export, ExportOutput, Target, TileWindow, Tiling

_TREE_ROW: Final = (
    '{"prototypeIndex":%d,"position":{"x":%.8f,"y":%.8f,"z":%.8f},"widthScale":%.3f,"heightScale":%.3f,'
    '"rotation":%.4f,"tint":%.3f},\n'
)
_FILES: Final = {
    "height": "heights: RAW, 16 bits, little-endian, first row south",
    "normal": "normals, Y+: red east, green north, blue up",
    "splat": "weights of four terrain layers: red, green, blue, alpha",
    "plants": "trees and shrubs as fields of TreeInstance",
    "grass": "grass, flowers and ferns as fields of TreeInstance",
}


def _write_unity(export: Export) -> ExportOutput:
    """Write the files of Unity's terrains.

    Rows start in the south, as *Import Raw* puts a file's first row at z = 0 and scales numbers by 1/65536 of
    the terrain's height (``ImportRawHeightmap`` in Unity's reference source); so do the weights, whose images
    have north at the top, as Unity flips images. Trees are in terrain space, 0 … 1 ("TreeInstance" in Unity's
    documentation), at the heights of these files.
    """
    steps = HeightQuantisation.from_heights(export.samples.height, export.options.heights)
    # The south-west corner of all terrains is at the origin.
    axes = EngineAxes("east", "up", "north", origin=(export.grid.west, export.grid.south, 0.0))
    files = write_tiles(export, "unity", "Heights and splat maps", partial(_write_images, export, steps))
    if requested_storeys(export.options):
        files |= write_tiles(export, "plants", "Plants", partial(_write_trees, export, steps))
    files |= write_corridors(export, axes, splat=True)
    facts = {
        "heights": steps.metadata,
        "byte_order": "little-endian",
        "orientation": {
            "raw": {"row_0": "south", "column_0": "west", "samples": "vertices"},
            "images": {"row_0": "north", "column_0": "west"},
        },
        "axes": axes.metadata,
        "layers": [
            {"name": name, "file": f"splat{index // 4 + 1}", "channel": CHANNELS[index % 4]}
            for index, name in enumerate(export.terrain.material_names)
        ],
        "species": list(export.terrain.species_names),
    }
    return ExportOutput(files, _settings(export, steps), facts)


def _write_images(
    export: Export, steps: HeightQuantisation, tile: TileWindow, samples: TerrainSamples
) -> dict[Path, str]:
    raw = write_raw(tile_path(export, "", tile, ".raw"), steps.encode(samples.height)[::-1], "<u2")
    normal = write_values_png(tile_path(export, "normal", tile, ".png"), samples.normal)
    weights = splat_weights(samples.weights)
    splats = [
        write_values_png(tile_path(export, f"splat{number}", tile, ".png"), rgba_weights(weights, first))
        for number, first in enumerate(range(0, weights.shape[-1], 4), start=1)
    ]
    return {raw: _FILES["height"], normal: _FILES["normal"]} | dict.fromkeys(splats, _FILES["splat"])


def _settings(export: Export, steps: HeightQuantisation) -> dict[str, Any]:
    tiles = list(tile_samples(export))
    first, samples = tiles[0]
    west, south, east, north = samples.grid.bounds
    return {
        "where": "Terrain, Terrain Settings, Import Raw",
        "Depth": "Bit 16",
        "Resolution": first.columns,
        "Byte Order": "Windows",
        "Flip Vertically": False,
        "Terrain Size": {"X": east - west, "Y": steps.range, "Z": north - south},
        "Control Texture Resolution": first.columns - 1,
        "tiles": [  # the position of a Transform is the terrain's south-west corner
            {
                "file": tile_path(export, "", tile, ".raw").name,
                "Position": {
                    "X": samples.grid.west - export.grid.west,
                    "Y": steps.low,
                    "Z": samples.grid.south - export.grid.south,
                },
            }
            for tile, samples in tiles
        ],
    }


def _write_trees(
    export: Export, steps: HeightQuantisation, tile: TileWindow, samples: TerrainSamples
) -> dict[Path, str]:
    head = {
        "format": 1,
        "terrain": tile_path(export, "", tile, ".raw").name,
        "prototypes": list(export.terrain.species_names),
    }
    files = {}
    for storey, kind in requested_storeys(export.options).items():
        chunks = plant_chunks(export.terrain.foliage_pieces(*samples.grid.bounds, storey=storey))
        rows = (_tree_rows(plants, samples, steps) for plants in chunks)
        path = tile_path(export, kind, tile, ".json")
        files[write_json_list(path, head, "instances", rows)] = _FILES[kind]
    return files


def _tree_rows(plants: npt.NDArray[np.void], samples: TerrainSamples, steps: HeightQuantisation) -> bytes:
    west, south, east, north = samples.grid.bounds
    height = (interpolate_heights(samples, plants["x"], plants["y"]) - steps.low) / steps.range
    # Unity's angles are clockwise seen from above.
    rotation = np.mod(-plants["rotation"].astype(np.float64), 2.0 * np.pi)
    return format_rows(
        _TREE_ROW,
        plants["species"],
        (plants["x"] - west) / (east - west),
        np.clip(height, 0.0, 1.0),
        (plants["y"] - south) / (north - south),
        plants["scale"],
        plants["scale"],
        rotation,
        plants["tint"],
    ).removesuffix(b",\n")


TARGETS: Final = (
    Target(
        name="unity",
        title="Unity",
        summary="RAW heights of 2ⁿ + 1, splat maps, tree instances, water",
        write=_write_unity,
        sizes=(33, 65, 129, 257, 513, 1025, 2049, 4097),
        square=True,
        options=NAMED_TILES | {"heights"},
        tiling=Tiling(pattern="{name}_{x}_{y}", from_south=True),
        memory=24.0,
        bytes_per_plant=180.0,
    ),
)
