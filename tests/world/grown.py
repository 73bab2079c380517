"""A stored world in memory, evaluated from a terrain."""

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.export.sampled import quantise_normals, quantise_weights
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.world.grid import CHUNK, DEFAULT_LAYERS, World


class InMemoryWorld:
    """Layers of a terrain over bounds; chunks named in `broken` (layer, level, row, column) can't be read."""

    def __init__(self, terrain, bounds, cell, *, layers=DEFAULT_LAYERS):
        world = World(*bounds, cell)
        self.west, self.north, self.levels = world.west, world.north, world.levels
        self.layers, self.material_names = layers, MATERIALS
        self.broken = set()
        self.reads = 0
        self._sketch = terrain.sketch
        self.data = {}
        for level in self.levels:
            bands = list(
                terrain.window(
                    self.west,
                    self.north,
                    cell=level.cell,
                    left=0,
                    top=0,
                    columns=level.columns,
                    rows=level.rows,
                )
            )
            height, normal, weights = (
                np.concatenate([getattr(band, name) for band in bands])
                for name in ("height", "normal", "materials")
            )
            self.data["height", level.number] = height
            self.data["normal", level.number] = quantise_normals(normal).transpose(2, 0, 1)
            self.data["materials", level.number] = quantise_weights(weights).transpose(2, 0, 1)
            self.data["exact normal", level.number] = normal.transpose(2, 0, 1)

    def sketch(self):
        return self._sketch

    def read(self, layer, level, *, top, left, rows, columns):
        assert layer in self.layers
        whole = self.data[layer, level]
        assert 0 <= top < top + rows <= whole.shape[-2]
        assert 0 <= left < left + columns <= whole.shape[-1]
        self.reads += 1
        for row in range(top // CHUNK, (top + rows - 1) // CHUNK + 1):
            for column in range(left // CHUNK, (left + columns - 1) // CHUNK + 1):
                if (layer, level, row, column) in self.broken:
                    raise InputError(f"{level}/{layer}/{row}/{column}: broken")
        return whole[..., top : top + rows, left : left + columns].copy()
