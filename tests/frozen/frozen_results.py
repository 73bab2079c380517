"""SHA-256 of what the program computes from frozen sketches: compared with the stored ones, or stored.

python tests/frozen/frozen_results.py [--device NAME]   compares all
python tests/frozen/frozen_results.py --write           stores them: make freeze
"""

import argparse
import hashlib
import json
import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.surfaces import Tile

Hashes = dict[str, dict[str, str]]
"""By part (what was placed, the plants, a tile level) and array."""

DATA = Path(__file__).parents[1] / "data" / "frozen"
RESULTS = DATA / "results.json"
LEVELS = {"presets": (0, 4, 10), "random": (0, 6)}
"""Tile levels: for presets cells of 48 … 256 m, 3 … 16 m and 0.05 … 0.25 m."""
PLANTS = {"woody": 96.0, "grass": 10.0}
"""Sides of the squares (m) whose plants are hashed, by storey."""


def sketches() -> list[str]:
    """Names of all frozen sketches, presets first."""
    return sorted(path.relative_to(DATA).with_suffix("").as_posix() for path in DATA.glob("*/*.sketch"))


def hashes_of(name: str, context: ComputeContext, *, levels: Iterable[int] | None = None) -> Hashes:
    """Build a frozen sketch and hash what it gives, at some or all of its levels."""
    terrain = build(load_sketch(DATA / f"{name}.sketch"), device=context)
    at = places(terrain)
    found = {"rivers and lakes": water(terrain), "plants": plants(terrain, at)}
    for level in LEVELS[name.split("/")[0]] if levels is None else levels:
        cell, arrays = ground(terrain, level, at)
        found[f"cells of {cell:.3g} m"] = arrays
    return found


def places(terrain: Terrain) -> dict[str, tuple[float, float]]:
    """Positions (m) that show something of everything: the widest feature of each type, waters, covers."""
    recipe, (east, north) = terrain.recipe, terrain.size
    found = {"middle": (0.5 * east, 0.5 * north), "outside": (-0.15 * east, 1.1 * north)}
    for number, name in enumerate(FEATURE_TYPES):
        own = recipe.points.painted[recipe.points.painted["type"] == number]
        if len(own):
            widest = own[np.argmax(own["radius"])]
            found[name] = (float(widest["x"]), float(widest["y"]))
    if recipe.rivers:
        points = max((river.points for river in recipe.rivers), key=len)
        found["river"] = tuple(points[len(points) // 2, :2].tolist())
    for name, painted in (("lake", recipe.lakes), ("cover", recipe[CoversLayer].covers)):
        if painted:
            field = max((each.shape for each in painted), key=lambda shape: shape.inside.max())
            row, column = np.unravel_index(np.argmax(field.inside), field.inside.shape)
            found[name] = (field.west + column * field.spacing, field.south + row * field.spacing)
    return found


def water(terrain: Terrain) -> dict[str, str]:
    rivers, lakes = terrain.recipe.rivers, terrain.recipe.lakes
    lines = [line for river in rivers for line in (river.points, river.centreline)]
    levels = [line[:, 2] for line in lines] + [np.array([lake.level for lake in lakes])]
    return {
        "river points": sha256(line[:, :2] for line in lines),
        "river widths": sha256(each for river in rivers for each in (river.centreline_width, river.width)),
        "river depths": sha256(each for river in rivers for each in (river.centreline_depth, river.depth)),
        "water levels": sha256(levels),
    }


def plants(terrain: Terrain, at: dict[str, tuple[float, float]]) -> dict[str, str]:
    x, y = at.get("forest", at["middle"])
    found = {}
    for storey, side in PLANTS.items():
        square = (x - 0.5 * side, y - 0.5 * side, x + 0.5 * side, y + 0.5 * side)
        grown = terrain.foliage(*square, storey=storey)
        species = np.array([terrain.species_names[number] for number in grown["species"]], "S16")
        fields = [name for name in grown.dtype.names if name != "species"]
        found[storey] = sha256([species, *(grown[field] for field in fields)])
    return found


def ground(terrain: Terrain, level: int, at: dict[str, tuple[float, float]]) -> tuple[float, dict[str, str]]:
    """Cell size (m) of a level, and the hashes of its tiles at some positions."""
    width = terrain.extent / 2.0**level
    keys = sorted({(level, math.floor(x / width), math.floor(y / width)) for x, y in at.values()})
    tiles = terrain.tiles(keys)
    return tiles[0].cell_size, {
        "heights": sha256(each for tile in tiles for each in (tile.height, tile.parent_height)),
        "normals": sha256(each for tile in tiles for each in (tile.normal, tile.parent_normal)),
        "material weights": weights(tiles, terrain.material_names),
    }


def weights(tiles: Sequence[Tile], names: Sequence[str]) -> str:
    """Hash material weights by name: neither their order nor a material that is nowhere counts."""
    arrays = []
    for number, name in sorted(enumerate(names), key=lambda each: each[1]):
        own = [tile.materials[..., number] for tile in tiles]
        if any(each.any() for each in own):
            arrays += [np.array(name, "S"), *own]
    return sha256(arrays)


def sha256(arrays: Iterable[np.ndarray]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype.str} {array.shape} ".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def differences(name: str, found: Hashes, device: str) -> list[str]:
    """One line for each array of a sketch that is not as stored."""
    stored: Hashes = json.loads(RESULTS.read_text())[name]
    return [
        f"{name}, {part}: {array} on {device}"
        for part, arrays in found.items()
        for array, digest in arrays.items()
        if stored.get(part, {}).get(array) != digest
    ]


HOW_TO_REGENERATE = (
    "differ from tests/data/frozen/results.json. If the change is meant and allowed (docs/testing.md, Frozen "
    "results), run `make freeze`, look at what changed, and explain why in the same commit."
)


def main() -> int:
    parser = argparse.ArgumentParser(description="Compare the frozen results with the stored ones.")
    some = parser.add_mutually_exclusive_group()
    some.add_argument("--write", action="store_true", help="store them instead")
    some.add_argument("--every", type=int, default=1, metavar="N", help="compare each Nth sketch only")
    parser.add_argument("--device", help="as for sketchterrain's --device")
    arguments = parser.parse_args()
    context = ComputeContext(arguments.device)
    found = {name: hashes_of(name, context) for name in sketches()[:: arguments.every]}
    if arguments.write:
        RESULTS.write_text(json.dumps(found, indent=1) + "\n")
        return 0
    device = f"{context.device.name} ({context.device.platform})"
    lines = [line for name, hashes in found.items() for line in differences(name, hashes, device)]
    if lines:
        sys.stdout.write("\n".join([*lines, HOW_TO_REGENERATE, ""]))
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
