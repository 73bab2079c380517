"""Stones as triangles: a ball cut flat by planes, as frost and falls break rock, then weathered by noise."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.render.strewn import Mesh

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array, Int64Array


VERTEX: Final = np.dtype([("place", "<f4", 3), ("outward", "<f4", 3)])
"""In radii of the stone; a unit normal."""


class _Shape(NamedTuple):
    """How a stone is broken and worn."""

    axes: tuple[float, float, float]  # half widths, the last upward
    cuts: int  # planes
    depth: float  # radii that they cut off at most
    edge: float  # how sharp edges are left: the power by which cuts join
    waves: float  # radii that it is rough, of the size of a third
    grain: float  # radii that it is rough, ever finer


SHAPES: Final = (
    _Shape((1.0, 0.82, 0.72), 17, 0.42, 26.0, 0.05, 0.018),  # a block
    _Shape((1.0, 0.70, 0.60), 13, 0.46, 34.0, 0.04, 0.016),  # a sharp one
    _Shape((1.0, 0.88, 0.42), 14, 0.34, 26.0, 0.04, 0.015),  # a slab
    _Shape((1.0, 0.90, 0.76), 24, 0.26, 11.0, 0.07, 0.016),  # a worn boulder
    _Shape((1.0, 0.80, 0.58), 22, 0.20, 7.0, 0.04, 0.006),  # a river's
)
DETAILS: Final = 4
"""Levels of detail, 0 the finest."""
_SPLITS: Final = (4, 3, 2, 1)
"""Times that each triangle of an icosahedron is split into four."""


def rock_mesh(shape: int, detail: int) -> Mesh:
    """Make a stone, one of `SHAPES`; all details are samples of the same surface."""
    directions, triangles = _ball(_SPLITS[detail])
    place = directions * _radius(directions, shape)[:, None] * np.array(SHAPES[shape].axes)
    a, b, c = (place[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    outward = np.zeros_like(place)
    for k in range(3):
        np.add.at(outward, triangles[:, k], across)
    vertices = np.empty(len(place), VERTEX)
    vertices["place"] = place
    vertices["outward"] = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    return Mesh(vertices, triangles.astype(np.uint32))


def _radius(directions: Float64Array, shape: int) -> Float64Array:
    """Return how far (radii) a stone reaches in unit directions."""
    rng = np.random.default_rng([11, shape])
    form = SHAPES[shape]
    normals = _unit(rng.standard_normal((form.cuts, 3)))
    away = 1.0 - form.depth * rng.uniform(0.0, 1.0, form.cuts) ** 0.7
    facing = np.maximum(directions @ normals.T, 0.0) / away
    # A power mean of how near the planes are: the nearest wins, edges are rounded off a little.
    cut = (1.0 + np.sum(facing**form.edge, axis=1)) ** (-1.0 / form.edge)
    rough = form.waves * _waves(rng, directions, 3.1)
    for octave in range(4):
        rough += form.grain * 0.62**octave * _waves(rng, directions, 6.5 * 1.9**octave)
    return np.asarray(cut * (1.0 + rough))


def _waves(rng: np.random.Generator, directions: Float64Array, frequency: float) -> Float64Array:
    """Return noise of a frequency (rad a radius) and deviation 1: plane waves in all directions."""
    ways = _unit(rng.standard_normal((9, 3))) * frequency * rng.uniform(0.7, 1.3, (9, 1))
    phases = rng.uniform(0.0, 2.0 * np.pi, 9)
    return np.asarray(np.sin(directions @ ways.T + phases).sum(axis=1) * np.sqrt(2.0 / 9.0))


@cache
def _ball(splits: int) -> tuple[Float64Array, Int64Array]:
    """Split each triangle of an icosahedron so often; return unit vectors and triangles counter-clockwise."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    flat = np.array([[-1, golden], [1, golden], [-1, -golden], [1, -golden]])
    zero = np.zeros((4, 1))
    points = _unit(
        np.concatenate(
            [np.hstack([flat, zero]), np.hstack([zero, flat]), np.hstack([flat[:, 1:], zero, flat[:, :1]])]
        )
    )
    corners = [
        (i, j, k) for i in range(12) for j in range(i) for k in range(j) if _are_near(points[[i, j, k]])
    ]
    triangles = np.array(corners)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    for _ in range(splits):
        points, triangles = _split(points, triangles)
    return points, triangles


def _are_near(points: Float64Array) -> bool:
    return bool(max(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)) < 1.1)


def _split(points: Float64Array, triangles: Int64Array) -> tuple[Float64Array, Int64Array]:
    edges = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    single, where = np.unique(edges, axis=0, return_inverse=True)
    middle = _unit(points[single[:, 0]] + points[single[:, 1]])
    ab, bc, ca = (len(points) + where.reshape(3, -1)).astype(np.int64)
    a, b, c = triangles.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([points, middle]), np.concatenate([np.column_stack(part) for part in parts])


def _unit(vectors: Float64Array) -> Float64Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
