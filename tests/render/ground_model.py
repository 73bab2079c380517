"""The ground's vertex shader in NumPy float32, and vertices packed from a terrain's tiles: oracles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sketchterrain.terrain.lattice import LATTICE_BITS, metres_per_unit
from sketchterrain.tiles.borders import tile_indices
from sketchterrain.tiles.morph import morph_weights

QUADS = 64
SIDE = QUADS + 1
VERTEX = np.dtype(
    [
        ("height", "<f4"),
        ("parent_height", "<f4"),
        ("slope", "<i2", 2),
        ("parent_slope", "<i2", 2),
        ("weights", "u1", 8),
        ("parent_weights", "u1", 8),
    ]
)


@dataclass
class Draws:
    slots: np.ndarray
    corners: np.ndarray
    steps: np.ndarray
    cases: np.ndarray
    morph: np.ndarray

    @classmethod
    def of(cls, keys, *, cases=None, morph=None, slots=None):
        keys = np.asarray(keys, np.int64).reshape(-1, 3)
        width = 1 << (LATTICE_BITS - keys[:, 0])
        corners = np.stack([keys[:, 1] * width, (keys[:, 2] + 1) * width], axis=1)
        none = np.zeros(len(keys), np.int64)
        return cls(
            np.arange(len(keys)) if slots is None else np.asarray(slots),
            corners,
            width // QUADS,
            none if cases is None else np.asarray(cases, np.int64),
            np.zeros((len(keys), 3, 3), np.float32) if morph is None else np.asarray(morph, np.float32),
        )

    def part(self, tile):
        """One tile alone, whose vertices are the first of their buffer."""
        one = slice(tile, tile + 1)
        return Draws(
            np.zeros(1, np.int64), self.corners[one], self.steps[one], self.cases[one], self.morph[one]
        )


def packed(tile):
    vertices = np.zeros((SIDE, SIDE), VERTEX)
    vertices["height"] = tile.height
    vertices["slope"] = np.rint(tile.normal[..., :2] * 32767.0)
    vertices["weights"] = np.rint(tile.materials * 255.0)
    return vertices


def add_parent(vertices, key, parent):
    """Fill the parent's part of a tile from the vertices of its parent, None for a root."""
    for name in ("height", "slope", "weights"):
        if parent is None:
            vertices[f"parent_{name}"] = vertices[name]
            continue
        top, left = QUADS // 2 * (1 - key[2] % 2), QUADS // 2 * (key[1] % 2)
        part = parent[name][top : top + QUADS // 2 + 1, left : left + QUADS // 2 + 1]
        fine = part.astype(np.float32 if name == "height" else np.float64)
        whole = np.zeros((SIDE, SIDE, *fine.shape[2:]), fine.dtype)
        whole[::2, ::2] = fine
        whole[::2, 1::2] = 0.5 * (fine[:, :-1] + fine[:, 1:])
        whole[1::2, ::2] = 0.5 * (fine[:-1] + fine[1:])
        whole[1::2, 1::2] = 0.5 * (fine[:-1, :-1] + fine[1:, 1:])
        vertices[f"parent_{name}"] = whole if name == "height" else np.rint(whole)


def pack_tiles(terrain, keys):
    """Vertices of tiles, (n, SIDE, SIDE) of VERTEX, with their parents' part."""
    keys = [tuple(map(int, key)) for key in keys]
    above = [(level - 1, col >> 1, row >> 1) for level, col, row in keys]
    own, parents = terrain.tiles(keys), terrain.tiles(above)
    vertices = np.stack([packed(tile) for tile in own])
    for each, key, parent in zip(vertices, keys, parents, strict=True):
        add_parent(each, key, packed(parent))
    return vertices


def shaded(draws, vertices, extent, eye):
    """What the shader computes: places (n, SIDE, SIDE, 3) float32, parent's shares, slopes, weights."""
    unit = metres_per_unit(extent)
    here = np.floor(np.asarray(eye[:2]) / unit)
    fraction = np.float32(np.asarray(eye[:2]) - here * unit)
    along = np.arange(SIDE)
    step = draws.steps[:, None, None]
    corner = draws.corners - here.astype(np.int64)
    places = np.empty((len(draws.slots), SIDE, SIDE, 3), np.float32)
    for axis, units in enumerate(
        (corner[:, 0, None, None] + along * step, corner[:, 1, None, None] - along[:, None] * step)
    ):
        assert np.abs(units).max() < 2**31
        places[..., axis] = units.astype(np.float32) * np.float32(unit) - fraction[axis]
    share = morph_weights(draws.morph, QUADS)
    mine = vertices[draws.slots]
    own = np.float32(1) - share
    places[..., 2] = (own * mine["height"] + share * mine["parent_height"]) - np.float32(eye[2])
    mixed = {
        name: own[..., None] * mine[name].astype(np.float32)
        + share[..., None] * mine[f"parent_{name}"].astype(np.float32)
        for name in ("slope", "weights")
    }
    return places, share, mixed["slope"], mixed["weights"]


def open_edges(draws, places):
    """Return edges of drawn triangles that no other triangle has the other way round: (k, 2, 3) float32.

    A whole surface has them along its outer border alone, whatever its tiles and levels.
    """
    indices, first, count = tile_indices(QUADS)
    flat = places.reshape(len(places), SIDE * SIDE, 3)
    starts, ends = [], []
    for tile, case in enumerate(draws.cases):
        triangles = indices[first[case] : first[case] + count[case]].reshape(-1, 3)
        for a, b in ((0, 1), (1, 2), (2, 0)):
            starts.append(flat[tile][triangles[:, a]])
            ends.append(flat[tile][triangles[:, b]])
    start, end = np.concatenate(starts), np.concatenate(ends)
    _, names = np.unique(
        np.concatenate([start, end]).view(np.dtype((np.void, 12))).ravel(), return_inverse=True
    )
    begin, finish = names[: len(start)].astype(np.int64), names[len(start) :].astype(np.int64)
    edges, back = begin << 32 | finish, finish << 32 | begin
    assert (begin != finish).all()
    lonely = ~np.isin(edges, back)
    return np.stack([start[lonely], end[lonely]], axis=1)
