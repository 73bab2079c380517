"""Samples of all that is evaluated of a terrain, and where two terrains differ."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sketchterrain.array_types import Bounds
from sketchterrain.generation.terrain import Terrain

_CELLS = (0.0, 1 / 100)  # of the extent
_POINTS = ((0.5, 0.5, 1.3, 120), (-30.0, 20.0, 0.1, 12))  # x, y and width of squares in extents; how many
_QUADS = 32
# From far to near, parents before children: level, and position in extents.
_TILES = (
    *((-1, 0.5, 0.5), (0, 0.5, 0.5), (2, 0.4, 0.3), (3, 0.45, 0.3), (6, 0.5, 0.5)),
    *((1, -0.4, -0.4), (3, -0.2, 0.7), (12, 0.3, 0.6)),
)
_PLANTS = (("woody", 60.0), ("grass", 4.0))  # storey and side of a square (m) in the middle


@dataclass(frozen=True, eq=False)
class Samples:
    """Values of one part of a terrain, and where they are: x, y (m) and the cell size that they depend on."""

    at: np.ndarray  # (n, 2) m
    cell: float  # m, by which changed areas are widened
    values: np.ndarray  # (n, bytes)

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, cell: float, values: np.ndarray) -> Samples:
        flat = np.ascontiguousarray(values).reshape(x.size, -1)
        return cls(np.stack([x.ravel(), y.ravel()], axis=-1), cell, flat.view(np.uint8))


def samples_of(terrain: Terrain) -> dict[str, Samples]:
    """Return heights at points, vertices of tiles with their parents' values, and one tile in floats."""
    extent, found = terrain.extent, {}
    rng = np.random.default_rng(1)
    squares = [rng.uniform(-0.5, 0.5, (count, 2)) * wide + [u, v] for u, v, wide, count in _POINTS]
    x, y = np.concatenate(squares).T * extent
    for cell in _CELLS:
        heights = terrain.heights(x, y, cell_size=cell * extent)
        found[f"points, cells of {cell} extents"] = Samples.of(x, y, 0.0, heights)
    keys = [(level, int(np.floor(u * 2.0**level)), int(np.floor(v * 2.0**level))) for level, u, v in _TILES]
    slot = {key: number for number, key in enumerate(keys)}
    parents = [slot.get((level - 1, column >> 1, row >> 1), -1) for level, column, row in keys]
    store = terrain.vertex_store(len(keys), quads=_QUADS)
    facts = terrain.write_tiles(keys, range(len(keys)), parents, store)
    vertices = store.download()
    for key, tile, parent in zip(keys, vertices, parents, strict=True):
        width = extent * 2.0 ** -key[0]
        line = np.linspace(0.0, width, _QUADS + 1)
        x, y = np.meshgrid(key[1] * width + line, key[2] * width + line[::-1])
        parts = vertices.dtype.names
        own = [name for name in parts if not name.startswith("parent")]
        found[f"tile {key}"] = Samples.of(x, y, width / _QUADS, _columns(tile, own))
        if parent >= 0:
            others = [name for name in parts if name.startswith("parent")]
            found[f"parent of {key}"] = Samples.of(x, y, 3 * width / _QUADS, _columns(tile, others))
    nowhere = np.full(len(keys), np.nan)
    found["facts of tiles"] = Samples.of(nowhere, nowhere, 0.0, _columns(facts, facts.dtype.names))
    tile = terrain.tile(0, 0, 0)
    x, y = np.meshgrid(*(np.linspace(0.0, extent, len(tile.height)),) * 2)
    values = np.concatenate([tile.height[..., None], tile.normal, tile.materials], axis=-1)
    found["floats of (0, 0, 0)"] = Samples.of(x, y[::-1], tile.cell_size, values)
    return found


def _columns(rows: np.ndarray, names: Iterable[str]) -> np.ndarray:
    """Return the bytes of some columns of a structured array, (rows, bytes)."""
    flat = np.ascontiguousarray(rows).ravel()
    parts = [np.ascontiguousarray(flat[name]).reshape(flat.size, -1).view(np.uint8) for name in names]
    return np.concatenate(parts, axis=-1)


def differences(one: dict[str, Samples], other: dict[str, Samples], areas: Sequence[Bounds] = ()) -> str:
    """Return in which parts two terrains differ outside of some areas; empty if they are bit-equal there."""
    lines = []
    for name, samples in one.items():
        others = other[name].values
        changed = np.ones(len(others), np.bool_)
        if samples.values.shape == others.shape:
            changed = (samples.values != others).any(axis=-1)
        x, y, wider = *samples.at.T, samples.cell * (1 + 1e-9)
        for west, south, east, north in areas:
            changed &= (x < west - wider) | (x > east + wider) | (y < south - wider) | (y > north + wider)
        if changed.any():
            lines.append(f"{name}: {changed.sum()} of {changed.size}, first at {samples.at[changed][0]}")
    return "\n".join(lines)


def plants_of(terrain: Terrain) -> bytes:
    middle, found = 0.5 * terrain.extent, [terrain.features.points.tobytes()]
    for storey, side in _PLANTS:
        found.append(terrain.foliage(middle, middle, middle + side, middle + side, storey=storey).tobytes())
    return b"".join(found)
