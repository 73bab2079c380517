"""The surfaces that are measured: the presets, and bare ground without any feature."""

import numpy as np

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.terrain.building import build
from sketchterrain.terrain.terrain import Terrain

BARE = "bare"
"""Ground of the default relief over 4096 m: octaves of noise and no feature at all."""
BARE_SEED = 7

TileKey = tuple[int, int, int]


def open_ground(name: str, context: ComputeContext) -> Terrain:
    """Return the terrain of a preset with its own seed, or of bare ground with :data:`BARE_SEED`."""
    sketch = Sketch(name=BARE, seed=BARE_SEED) if name == BARE else load_sketch(name)
    return build(sketch, device=context)


def central_keys(level: int, count: int) -> list[TileKey]:
    """Return ``count`` tiles that lie together around the middle of a square sketch."""
    side = int(np.ceil(np.sqrt(count)))
    first = 2**level // 2 - side // 2 if level > 0 else 0
    return [(level, first + i % side, first + i // side) for i in range(count)]


def scattered_keys(level: int, count: int, terrain: Terrain, *, seed: int) -> list[TileKey]:
    """Return up to ``count`` different tiles that lie anywhere within the sketch, drawn with the seed."""
    width = terrain.extent / 2.0**level
    columns, rows = (max(int(length / width), 1) for length in terrain.size)
    draw = np.random.default_rng(seed)
    wanted = min(count, columns * rows)
    keys: dict[TileKey, None] = {}
    while len(keys) < wanted:
        keys[level, int(draw.integers(columns)), int(draw.integers(rows))] = None
    return list(keys)
