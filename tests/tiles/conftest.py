"""A terrain that differs at every level, and its displayed triangles with exact positions."""

import sys

import numpy as np
import pytest

from sketchterrain.tiles.lod import CameraView, morph_weights
from sketchterrain.tiles.quadtree import code_of, tile_indices
from sketchterrain.tiles.refinement import ROOT_LEVEL
from sketchterrain.tiles.stream import TileStream

EXTENT = 1024.0
QUADS = 4
LATTICE = 1 << 24
FACTS = [("low", "f8"), ("high", "f8"), ("error", "f8")]


def codes_of(keys):
    return code_of(*np.array(keys, np.int64).T)


def mix(*numbers):
    """Hash integers to [-1, 1)."""
    total = np.uint64(0x9E3779B97F4A7C15)
    with np.errstate(over="ignore"):
        for number in numbers:
            total = (total ^ np.asarray(number, np.int64).astype(np.uint64)) * np.uint64(0xBF58476D1CE4E5B9)
            total ^= total >> np.uint64(29)
    return (total >> np.uint64(11)).astype(np.float64) / 2.0**52 - 1.0


def roughness(level):
    """Difference of a level's terrain from the coarser level's, m."""
    return 6.0 * np.exp2(-0.7 * np.asarray(level, np.float64))


def own_height(level, x, y):
    return sum(roughness(k) * mix(k, x, y) for k in range(ROOT_LEVEL, level + 1))


def heights_of(key, quads):
    """Own and parent's heights at a tile's vertices, rows from the north, and their lattice coordinates."""
    width = LATTICE >> key.level if key.level >= 0 else LATTICE << -key.level
    step = width // quads
    x = key.col * width + np.arange(quads + 1) * step + np.zeros((quads + 1, 1), np.int64)
    y = (key.row + 1) * width - np.arange(quads + 1)[:, None] * step + np.zeros(quads + 1, np.int64)
    own = own_height(key.level, x, y)
    if key.level == ROOT_LEVEL:
        return x, y, own, own
    coarse = own_height(key.level - 1, x, y)
    parent = coarse.copy()
    # Vertices that the parent lacks lie in the middle of its edges or of its diagonals; tiles are even.
    parent[:, 1::2] = 0.5 * (coarse[:, :-1:2] + coarse[:, 2::2])
    parent[1::2] = 0.5 * (coarse[:-1:2] + coarse[2::2])
    parent[1::2, 1::2] = 0.5 * (coarse[:-1:2, :-1:2] + coarse[2::2, 2::2])
    return x, y, own, parent


def facts_of(keys, quads):
    facts = np.zeros(len(keys), FACTS)
    for i, key in enumerate(keys):
        _, _, *both = heights_of(key, quads)
        facts[i] = np.min(both), np.max(both), 2.0 * roughness(key.level + 1) * (1.0 + 0.5 * mix(99, *key))
    return facts


def drawn_triangles(draws, quads):
    """Vertices (n, 3, 3): x, y in lattice units, height in m; n triangles."""
    indices, first, count = tile_indices(quads)
    weights = morph_weights(draws.morph, quads)
    parts = []
    for i, key in enumerate(draws.keys):
        x, y, own, parent = heights_of(key, quads)
        m = weights[i].astype(np.float64)
        z = np.where(m == 1, parent, (1 - m) * own + m * parent)
        vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
        case = draws.cases[i]
        parts.append(vertices[indices[first[case] : first[case] + count[case]].reshape(-1, 3)])
    return np.concatenate(parts)


def open_edges(triangles):
    """Edges (n, 2, 3) without a second triangle with identical vertices."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    vertex = mix(*np.moveaxis(edges.view(np.int64), -1, 0)).view(np.int64)
    forward, backward = (mix(*vertex.T[::order]).view(np.int64) for order in (1, -1))
    assert np.unique(forward).size == forward.size, "an edge is drawn twice in one direction"
    return edges[~np.isin(forward, backward)]


def surface_at(triangles, x, y):
    """Height of the drawn surface at places (lattice units), NaN where nothing is drawn."""
    a, b, c = (triangles[:, k] for k in range(3))
    found = np.full(len(x), np.nan)
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    for i, (px, py) in enumerate(zip(x, y, strict=True)):
        u = ((px - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (py - a[:, 1])) / area
        v = ((b[:, 0] - a[:, 0]) * (py - a[:, 1]) - (px - a[:, 0]) * (b[:, 1] - a[:, 1])) / area
        inside = np.flatnonzero((u >= 0) & (v >= 0) & (u + v <= 1))
        if inside.size:
            k = inside[0]
            found[i] = a[k, 2] + u[k] * (b[k, 2] - a[k, 2]) + v[k] * (c[k, 2] - a[k, 2])
    return found


def view_from(eye, *, heading=0.0, pixels_per_radian=100.0, everywhere=True, **more):
    """A camera; `everywhere` sees all around, else half of the world."""
    planes = np.zeros((0, 4))
    if not everywhere:
        ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
        planes = np.array([[*ahead, -ahead @ eye]])
    return CameraView(
        tuple(float(v) for v in eye), planes, pixels_per_radian, draw_distance=16 * EXTENT, **more
    )


def new_stream(**more):
    return TileStream(EXTENT, quads=QUADS, **{"slots": 3000, "hide": False, "finest_cell": 8.0, **more})


def generate(batch):
    return facts_of(batch.keys, QUADS)


def go(stream, view, *, elapsed=1 / 30, tiles=6):
    """Advance one frame, generating at most `tiles`."""
    batch = stream.plan(view, budget=1.0)
    generated = type(batch)(batch.keys[:tiles], batch.slots[:tiles], batch.parents[:tiles])
    assert len(generated.keys) == len(batch.keys) or tiles < len(batch.keys)
    if generated:
        stream.mark_generated(generated, generate(generated), seconds=0.5 * 6 / tiles)
    return stream.advance(view, elapsed=elapsed)


def rested(stream, view, *, tiles):
    """Advance until a still camera needs no more tiles."""
    for _ in range(250):
        draws = go(stream, view, tiles=tiles)
        if stream.converged:
            return draws
    raise AssertionError("never converged")


def limited(stream, tiles):
    """Plan exactly this many tiles per second."""
    stream._cost.count_within = lambda levels, budget, **_: min(tiles, len(levels))
    stream._cost.record = lambda levels, seconds: None
    return stream


def rim(edges, view):
    """Which open edges (n, 2, 3) are beyond the draw distance."""
    away = edges[:, :, :2] * (EXTENT / LATTICE) - np.array(view.eye[:2])
    return (np.linalg.norm(away, axis=-1) > view.draw_distance * 0.999).all(axis=1)


def is_whole(draws, view):
    """Only the rim is open."""
    return rim(open_edges(drawn_triangles(draws, QUADS)), view).all()


@pytest.fixture(scope="session")
def toy():
    """This module: a terrain that differs at every level, and streams of its tiles."""
    return sys.modules[__name__]
