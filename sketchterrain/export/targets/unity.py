"""Unity: RAW heights, splat maps, tree instances, water, as its terrains take them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.export.engines import (
    EngineAxes,
    path_of,
    plants_within,
    storeys_of,
    tiles_of,
    write_all_water,
)
from sketchterrain.export.files import text_rows, write_listing, write_values_png
from sketchterrain.export.height_steps import HeightSteps
from sketchterrain.export.sampled import Sampled, ground_at
from sketchterrain.export.target import Export, Target, Written
from sketchterrain.export.tiling import Piece, Tiling
from sketchterrain.export.weights import edge_to_edge, four_of
from sketchterrain.whole_files import write_atomic

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


def unity_axes(export: Export) -> EngineAxes:
    """Return Unity's axes, with the south-west corner of all terrains at the origin."""
    return EngineAxes("east", "up", "north", origin=(export.grid.west, export.grid.south, 0.0))


def write_unity(export: Export) -> Written:
    """Write what Unity's terrains take.

    Rows come from the south, for *Import Raw* puts a file's first row at z = 0 and scales numbers by
    1/65536 of the terrain's height (``ImportRawHeightmap`` in Unity's reference source); so do the weights,
    whose images show north at the top, as Unity turns images. Trees are in the terrain's own space, 0 … 1
    ("TreeInstance" in Unity's documentation), on the ground as these heights have it.
    """
    steps = HeightSteps.of(export.sampled.height, export.options.heights)
    axes = unity_axes(export)
    files: dict[Path, str] = {}
    with export.stages.stage("unity", "Heights and splat maps") as tell:
        for done, (piece, tile) in enumerate(tiles_of(export), start=1):
            files |= _images(export, piece, tile, steps)
            tell(done / export.tiling.count)
    if storeys := storeys_of(export.options):
        with export.stages.stage("plants", "Plants") as tell:
            for done, (piece, tile) in enumerate(tiles_of(export), start=1):
                for storey, kind in storeys.items():
                    path = _write_trees(export, piece, tile, storey, kind, steps)
                    files[path] = _FILES[kind]
                tell(done / export.tiling.count)
    files |= write_all_water(export, axes)
    facts = {
        "heights": {"numbers": "uint16", **steps.facts},
        "byte_order": "little-endian",
        "orientation": {
            "raw": {"row_0": "south", "column_0": "west", "samples": "vertices"},
            "images": {"row_0": "north", "column_0": "west"},
        },
        "axes": axes.facts,
        "layers": _layers(export),
        "species": list(export.terrain.species_names),
    }
    return Written(files, _settings(export, steps, axes), facts)


def _images(export: Export, piece: Piece, tile: Sampled, steps: HeightSteps) -> dict[Path, str]:
    numbers = steps.encode(tile.height)[::-1].astype("<u2")
    raw = write_atomic(path_of(export, "", piece, ".raw"), numbers.tobytes())
    normal = write_values_png(path_of(export, "normal", piece, ".png"), tile.normal)
    weights = edge_to_edge(tile.weights)
    splats = [
        write_values_png(path_of(export, f"splat{number}", piece, ".png"), four_of(weights, first))
        for number, first in enumerate(range(0, weights.shape[-1], 4), start=1)
    ]
    return {raw: _FILES["height"], normal: _FILES["normal"]} | dict.fromkeys(splats, _FILES["splat"])


def _settings(export: Export, steps: HeightSteps, axes: EngineAxes) -> dict[str, Any]:
    """Return what to type in; tiles differ in their place alone."""
    tiles = list(tiles_of(export))
    west, south, east, north = tiles[0][1].grid.area
    side = tiles[0][0].columns
    return {
        "where": "Terrain, Terrain Settings, Import Raw",
        "Depth": "Bit 16",
        "Resolution": side,
        "Byte Order": "Windows",
        "Flip Vertically": False,
        "Terrain Size": {"X": east - west, "Y": steps.range, "Z": north - south},
        "Control Texture Resolution": side - 1,
        "tiles": [
            {
                "file": path_of(export, "", piece, ".raw").name,
                "Position": _position(axes, tile) | {"Y": steps.low},
            }
            for piece, tile in tiles
        ],
    }


def _position(axes: EngineAxes, tile: Sampled) -> dict[str, float]:
    """Return where the terrain's Transform stands: its south-west corner."""
    west, south, _, _ = tile.grid.area
    return dict(zip("XYZ", axes.places(*np.array([[west], [south], [0.0]]))[0].tolist(), strict=True))


def _layers(export: Export) -> list[dict[str, Any]]:
    channels = ("red", "green", "blue", "alpha")
    return [
        {"name": name, "file": f"splat{index // 4 + 1}", "channel": channels[index % 4]}
        for index, name in enumerate(export.terrain.material_names)
    ]


def _write_trees(
    export: Export, piece: Piece, tile: Sampled, storey: str, kind: str, steps: HeightSteps
) -> Path:
    head = {
        "format": 1,
        "terrain": path_of(export, "", piece, ".raw").name,
        "prototypes": list(export.terrain.species_names),
    }
    pieces = plants_within(export.terrain, tile.grid.area, storey)
    rows = (_tree_rows(plants, tile, steps) for plants in pieces)
    return write_listing(path_of(export, kind, piece, ".json"), head, "instances", rows)


def _tree_rows(plants: npt.NDArray[np.void], tile: Sampled, steps: HeightSteps) -> bytes:
    west, south, east, north = tile.grid.area
    height = (ground_at(tile, plants["x"], plants["y"]) - steps.low) / steps.range
    # Unity turns clockwise seen from above.
    turn = np.mod(-plants["rotation"].astype(np.float64), 2.0 * np.pi)
    return text_rows(
        _TREE_ROW,
        plants["species"],
        (plants["x"] - west) / (east - west),
        np.clip(height, 0.0, 1.0),
        (plants["y"] - south) / (north - south),
        plants["scale"],
        plants["scale"],
        turn,
        plants["tint"],
    ).removesuffix(b",\n")


TARGETS: Final = (
    Target(
        name="unity",
        title="Unity",
        line="RAW heights of 2ⁿ + 1, splat maps, tree instances, water",
        write=write_unity,
        sizes=(33, 65, 129, 257, 513, 1025, 2049, 4097),
        size=1025,
        square=True,
        knows=frozenset({"tiles", "tile_name", "tile_first", "tiles_from_south", "heights"}),
        tiling=Tiling(pattern="{name}_{x}_{y}", from_south=True),
        disk=16.0,
        memory=24.0,
        bytes_per_plant=180.0,
    ),
)
