"""Changed areas of rivers, against their flattened pieces of every cell size."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from sketchterrain.features.memory import ShapeMemory
from sketchterrain.sketch import Sketch, load_sketch
from sketchterrain.terrain import make_recipe
from sketchterrain.terrain.centrelines import TOLERANCE_CELLS
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_rivers
from sketchterrain.terrain.river_changes import river_areas

if TYPE_CHECKING:
    from sketchterrain.terrain.recipe import TerrainRecipe

PRESETS = ("valley_river", "alpine_range", "rolling_hills")


def painted_on(sketch: Sketch, seed: int) -> Sketch:
    rng = np.random.default_rng(seed)
    name = ("river", "mountain", "hill", "lake")[seed % 4]
    image = np.array(sketch.layers[name])
    at = rng.choice(np.argwhere(sketch.layers["river"] > 0)) + rng.normal(0, 25, 2)
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    radius = 3.0 if name == "river" else rng.uniform(5, 25)
    image[(rows - at[0]) ** 2 + (columns - at[1]) ** 2 <= radius**2] = rng.integers(0, 2)
    return sketch.replace(layers={**sketch.layers, name: image})


def pieces(recipe: TerrainRecipe, cell: float) -> dict[bytes, np.ndarray]:
    """Everything that kernels read of each piece, and the rectangle in which it has any effect."""
    packed, unit = pack_rivers(recipe, cell), metres_per_unit(recipe.extent)
    rows = np.column_stack([packed.start, packed.along, packed.up, packed.down])
    start = packed.start * unit
    ends = np.stack([start, start + packed.along[:, :2]])
    reach = np.maximum(packed.up[:, 3], packed.down[:, 3])[:, None]
    boxes = np.column_stack([ends.min(axis=0) - reach, ends.max(axis=0) + reach])
    return {row.tobytes(): box for row, box in zip(rows, boxes, strict=True)}


@pytest.mark.parametrize(
    "preset", [PRESETS[0], *(pytest.param(name, marks=pytest.mark.slow) for name in PRESETS[1:])]
)
def test_every_piece_that_changed_lies_in_the_areas(preset: str) -> None:
    sketch, memory = load_sketch(preset), ShapeMemory()
    old = make_recipe(sketch, memory=memory)
    assert river_areas(old, make_recipe(sketch)) == []
    changed = 0
    for seed in range(4 if preset == PRESETS[0] else 8):
        sketch = painted_on(sketch, seed)
        new = make_recipe(sketch, memory=memory)
        areas = np.array(river_areas(old, new)).reshape(-1, 4)
        for cell in TOLERANCE_CELLS:
            before, after = pieces(old, cell), pieces(new, cell)
            for row in before.keys() ^ after.keys():
                box = before[row] if row in before else after[row]
                inside = (areas[:, :2] <= box[:2]) & (areas[:, 2:] >= box[2:])
                assert inside.all(axis=1).any()
                changed += 1
        old = new
    assert changed > 100


def test_a_river_far_from_the_change_is_left_alone() -> None:
    sketch = load_sketch("valley_river")
    old = make_recipe(sketch)
    river = np.array(sketch.layers["river"])
    river[5:8, 5:9] = 1
    areas = river_areas(old, make_recipe(sketch.replace(layers={**sketch.layers, "river": river})))
    assert areas
    size = sum((east - west) * (north - south) for west, south, east, north in areas)
    assert size < 0.1 * sketch.extent**2
