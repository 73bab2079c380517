"""Mesh of drainage cells: an unbounded, irregular partition of the plane whose edges are valleys and passes.

Sites of a jittered square lattice of spacing L are triangulated by the shorter diagonal of every quad.
A triangle's centroid is a *mesh vertex*; the cell of a site is bounded by the medians around it, so a point
belongs to the site of its greatest barycentric coordinate. Each edge between two vertices is a valley, which
falls from one to the other, or rises to a pass (`mesh_vertices` tells which).

Everything is a function of integer indices: *mesh units* of L/1024, so that values do not depend on the
window that asks for them, nor on the distance from the origin.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.geometry.hashing import hash_keys, hash_unit
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_constants

SITE_BITS, _UNIT_BITS = (int(bits) for bits in kernel_constants("host/mesh.h", "SITE_BITS", "UNIT_BITS"))
"""Bits of the nodes of level 0, and of the mesh units, along the spacing of sites."""
SIDE, UNIT = 1 << (_UNIT_BITS - SITE_BITS), 1 << _UNIT_BITS
"""Mesh units between nodes of level 0, and along the spacing of sites."""

CORNER_X, CORNER_Y = np.array([0, 1, 1, 0]), np.array([0, 0, 1, 1])
"""Corners of quads: south-west, south-east, north-east, north-west."""


class MeshParameters(NamedTuple):
    """What the mesh depends on besides the fields of uplift: hash states and gradients."""

    jitter: np.uint64
    warp_x: np.uint64
    warp_y: np.uint64
    sway: np.uint64
    fall: float  # fall of a trunk valley along L (m)
    east: float  # direction of the tilt
    north: float
    phase: float  # of both waves of the tilt, 0 … 1
    across_phase: float


def mesh_parameters(seed: int, fall: float) -> MeshParameters:
    """Return the mesh's parameters by the seed and the trunk valleys' fall along L (m)."""
    jitter, warp_x, warp_y, sway = (
        np.uint64(hash_keys(seed, f"mesh {name}")) for name in ("jitter", "warp x", "warp y", "sway")
    )
    east, north = (2.0 * hash_unit(seed, "mesh tilt", np.array([0, 1])) - 1.0).tolist()
    length = sqrt(east * east + north * north)
    if length < 0.1:
        east, north, length = 1.0, 0.0, 1.0
    phases = hash_unit(seed, "mesh tilt phase", np.array([0, 1]))
    halfway = np.where(phases < 0.5, 0.25, 0.75).tolist()  # the sketch stands between crest and trough
    direction = east / length, north / length
    return MeshParameters(jitter, warp_x, warp_y, sway, fall, *direction, halfway[0], halfway[1])


class MeshTable(NamedTuple):
    """Sites and vertices of a rectangle of lattice quads, indexed [row, column(, half)].

    Sites have one more row and column than quads.
    """

    column: int  # of the first quad
    row: int
    site_x: Float64Array  # offset from the lattice point, L
    site_y: Float64Array
    diagonal: Int64Array
    height: Float64Array  # of vertices, m
    receiver: Int64Array  # 0 south, 1 east, 2 north, 3 west, 4 across the diagonal, −1 none
    upstream: Int64Array  # vertices that drain through this one, itself included, at most TRUNK
    relief: Float64Array  # of the ground at vertices, m
    site_relief: Float64Array  # of the ground at sites, m
    site_low: Float64Array  # height of the lowest vertex around sites, m


class PassRule(NamedTuple):
    """How high passes are."""

    rise: float  # above the higher vertex, over the relief
    low_rise: float  # … and at most above the lowest vertex of either cell
    slope: float  # … and above either vertex: slope over relief (1/m) where that is small, below 1
    length: float  # of L, m


def lattice_sites(
    mesh: MeshParameters, column: int, row: int, rows: int, columns: int
) -> tuple[Float64Array, Float64Array, Int64Array]:
    """Return offsets of sites (L) and diagonals of quads."""
    x, y = np.empty((rows + 1, columns + 1)), np.empty((rows + 1, columns + 1))
    diagonal = np.empty((rows, columns), np.int64)
    host_function("lattice_sites")(mesh, column, row, x, y, diagonal)
    return x, y, diagonal


def lowest_around_sites(diagonal: Int64Array, height: Float64Array) -> Float64Array:
    """Return the height of the lowest vertex around each site of a table."""
    low = np.empty((diagonal.shape[0] + 1, diagonal.shape[1] + 1))
    host_function("lowest_around_sites")(diagonal, height, low)
    return low
