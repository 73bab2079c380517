"""Mesh of drainage cells: an unbounded, irregular partition of the plane whose edges are valleys and passes.

Sites of a jittered square lattice of spacing L are triangulated by the shorter diagonal of every quad.
A triangle's centroid is a *mesh vertex*; the cell of a site is bounded by the medians around it, so a point
belongs to the site of its greatest barycentric coordinate. Each edge between two vertices is a valley, which
falls from one to the other, or rises to a pass (`mesh_vertices` tells which).

Everything is a function of integer indices: *mesh units* of L/1024, so that values do not depend on the
window that asks for them, nor on the distance from the origin.
"""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from math import floor, sqrt
from typing import NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.geometry.hashing import hash_keys, hash_unit
from sketchterrain.landforms.hashed_noise import compiled, hashed, value_noise, value_noise_row

UNIT_BITS = 10
"""Bits of the mesh units along the spacing of sites."""
SITE_BITS = 6
"""Bits of the nodes of level 0 along the spacing of sites."""
SIDE = 1 << (UNIT_BITS - SITE_BITS)
"""Mesh units between nodes of level 0."""

_JITTER = 0.34  # of a site, either side, in L
_WARP = (
    (9, 0.13),
    (7, 0.035),
)  # bits of the cells (mesh units) and amplitudes (L) of the warp of cells' borders
WARP = sum(amplitude for _, amplitude in _WARP)
"""Greatest displacement (L) of a border along either axis."""

_TILT_PERIOD = 256.0  # from crest to crest of the base level, in L
_TILT_ACROSS = 0.6  # gradient across over gradient along
_SHALLOW = 40.0  # height (in falls along L) below which troughs are shallow
_SWAY = ((13, 1.4), (12, 0.5))  # bits of the cells and ranges (in slope · cell) of the base level's noise
# The sketch stands on a swell, so that valleys lead away from it: those that led into the painted region
# would end at its border. Half the side of its top, the width of its slope (L), its height (falls along L).
_SWELL_HALF, _SWELL_WIDTH, _SWELL = 2.0, 2.0, 3.5

# Corners of a quad's triangles, by diagonal and half: 0 south-west, 1 south-east, 2 north-east, 3 north-west.
CORNERS = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
CORNER_X, CORNER_Y = np.array([0, 1, 1, 0]), np.array([0, 0, 1, 1])


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


@compiled
def _wave(t):
    """Return a wave of slope ±1 with rounded crests and troughs, of period 1."""
    t = t - floor(t)
    t = abs(2.0 * t - 1.0)  # 1 at integers, 0 between them
    if t < 0.1:
        t = 5.0 * t * t + 0.05
    elif t > 0.9:
        t = 0.95 - 5.0 * (1.0 - t) * (1.0 - t) + 0.0
    return 0.5 * t


@compiled
def base_level(mesh, x, y):
    """Return the height (m) that trunk valleys have at a point (mesh units, integers)."""
    scale = 1.0 / (1 << UNIT_BITS)
    east, north = (x - 2048) * scale, (y - 2048) * scale
    along, across = east * mesh.east + north * mesh.north, north * mesh.east - east * mesh.north
    level = _wave(along / _TILT_PERIOD + mesh.phase) - _wave(mesh.phase)
    level += _TILT_ACROSS * (_wave(across / _TILT_PERIOD + mesh.across_phase) - _wave(mesh.across_phase))
    level *= _TILT_PERIOD
    for bits, span in _SWAY:
        level += 0.5 * span * value_noise(mesh.sway + np.uint64(bits), x, y, bits) * (1 << bits) * scale / 1.5
    # Basins without outlet, in the deepest troughs, are shallow.
    above = level - _TILT_PERIOD * (1.0 + _TILT_ACROSS) * (0.025 - 0.25)
    s = above / _SHALLOW
    if s < 0.0:
        level += (0.1 * s - s) * _SHALLOW
    elif s < 1.0:
        level += (s * (0.1 + s * (1.8 - 0.9 * s)) - s) * _SHALLOW
    away_x, away_y = max(abs(east) - _SWELL_HALF, 0.0), max(abs(north) - _SWELL_HALF, 0.0)
    t = min(sqrt(away_x * away_x + away_y * away_y) / _SWELL_WIDTH, 1.0)
    level += _SWELL * (1.0 - t * t * (3.0 - 2.0 * t))
    return level * mesh.fall


@compiled
def site_offsets(mesh, column, row):
    """Return how far a site is from its lattice point, in L."""
    bits = hashed(mesh.jitter, column, row)
    low = np.float64(bits & np.uint64(0xFFFFFF)) * 2.0**-24
    high = np.float64(bits >> np.uint64(40)) * 2.0**-24
    return _JITTER * (2.0 * low - 1.0), _JITTER * (2.0 * high - 1.0)


@compiled
def _turn(ax, ay, bx, by, cx, cy):
    """Return twice the signed area of a triangle."""
    return (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)


@compiled
def _diagonal(ax, ay, bx, by, cx, cy, dx, dy):
    """Return the diagonal of a quad: 0 from its south-west corner, 1 from its south-east one."""
    if _turn(ax, ay, bx, by, cx, cy) <= 0.0 or _turn(ax, ay, cx, cy, dx, dy) <= 0.0:
        return 1
    if _turn(ax, ay, bx, by, dx, dy) <= 0.0 or _turn(bx, by, cx, cy, dx, dy) <= 0.0:
        return 0
    first = (cx - ax) * (cx - ax) + (cy - ay) * (cy - ay)
    return 0 if first <= (dx - bx) * (dx - bx) + (dy - by) * (dy - by) else 1


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


@compiled
def lattice_sites(mesh, column, row, rows, columns):
    """Return offsets of sites (L) and diagonals of quads."""
    x, y = np.empty((rows + 1, columns + 1)), np.empty((rows + 1, columns + 1))
    for j, i in np.ndindex(rows + 1, columns + 1):
        x[j, i], y[j, i] = site_offsets(mesh, column + i, row + j)
    diagonal = np.empty((rows, columns), np.int64)
    for j, i in np.ndindex(rows, columns):
        diagonal[j, i] = _diagonal(
            x[j, i], y[j, i], 1.0 + x[j, i + 1], y[j, i + 1],
            1.0 + x[j + 1, i + 1], 1.0 + y[j + 1, i + 1], x[j + 1, i], 1.0 + y[j + 1, i],
        )  # fmt: skip
    return x, y, diagonal


@compiled
def neighbour(diagonal, row, column, half, side):
    """Return row, column and half of the triangle beyond a side; row −1 if the table ends there.

    A triangle has the quad's south side if its half is 0, its north side if it is 1, and one of the others.
    """
    if side == 4:
        return row, column, 1 - half
    if side == 0:
        return row - 1, column, 1
    if side == 2:
        return (row + 1, column, 0) if row + 1 < diagonal.shape[0] else (-1, column, 0)
    if side == 1:
        if column + 1 >= diagonal.shape[1]:
            return -1, column, 0
        return row, column + 1, 1 - diagonal[row, column + 1]
    if column == 0:
        return -1, column, 0
    return row, column - 1, diagonal[row, column - 1]


@compiled
def triangle_sides(diagonal, half):
    """Return the sides of a triangle: two of the quad, and the diagonal."""
    if half == 0:
        return 0, (1 if diagonal == 0 else 3), 4
    return 2, (3 if diagonal == 0 else 1), 4


@compiled
def quad_side(first, second):
    """Return the side between two corners of a quad, 4 for a diagonal."""
    if first + second == 1:
        return 0
    if first + second == 5:
        return 2
    if (first - second) % 2 == 0:
        return 4
    return 1 if first + second == 3 and first != 0 and second != 0 else 3


@compiled
def side_corners(diagonal, side):
    """Return the corners of a quad at the ends of a side."""
    if side == 4:
        return (0, 2) if diagonal == 0 else (1, 3)
    return side, (side + 1) % 4


@compiled
def border_warp_row(mesh, x, step, y, east, north):
    """Write the displacements (L) of a row of points, `step` mesh units apart from (x, y) on."""
    east[:] = 0.0
    north[:] = 0.0
    for bits, amplitude in _WARP:
        value_noise_row(mesh.warp_x + np.uint64(bits), x, step, y, bits, amplitude, east)
        value_noise_row(mesh.warp_y + np.uint64(bits), x, step, y, bits, amplitude, north)


@compiled
def displaced(table, x, y, east, north):
    """Return the quad (row, column) of a point (mesh units), displaced (L), and the point in it (L)."""
    scale = 1.0 / (1 << UNIT_BITS)
    column, row = x >> UNIT_BITS, y >> UNIT_BITS
    px, py = (x - (column << UNIT_BITS)) * scale + east, (y - (row << UNIT_BITS)) * scale + north
    shift_x, shift_y = floor(px), floor(py)
    return row + shift_y - table.row, column + shift_x - table.column, px - shift_x, py - shift_y


@compiled
def triangle_at(table, row, column, x, y):
    """Return row, column and half of the triangle of a point, in L from the lattice point of its quad."""
    sites = table.diagonal, table.site_x, table.site_y
    for trial in range(18):
        # the quad of the point first, then those around it
        a = (trial // 2 + 4) % 9
        j, i, half = row + a // 3 - 1, column + a % 3 - 1, trial % 2
        if min(corner_areas(triangle_corners(*sites, j, i, half), x - (i - column), y - (j - row))) >= 0.0:
            return j, i, half
    return -1, -1, 0


@compiled
def triangle_corners(diagonal, site_x, site_y, row, column, half):
    """Return x and y of a triangle's corners, in L from the lattice point of its quad."""
    a, b, c = CORNERS[diagonal[row, column], half]
    return (
        CORNER_X[a] + site_x[row + CORNER_Y[a], column + CORNER_X[a]],
        CORNER_Y[a] + site_y[row + CORNER_Y[a], column + CORNER_X[a]],
        CORNER_X[b] + site_x[row + CORNER_Y[b], column + CORNER_X[b]],
        CORNER_Y[b] + site_y[row + CORNER_Y[b], column + CORNER_X[b]],
        CORNER_X[c] + site_x[row + CORNER_Y[c], column + CORNER_X[c]],
        CORNER_Y[c] + site_y[row + CORNER_Y[c], column + CORNER_X[c]],
    )


@compiled
def corner_areas(corners, x, y):
    """Return twice the signed areas of a point's triangles with the sides opposite to each corner."""
    ax, ay, bx, by, cx, cy = corners
    return _turn(x, y, bx, by, cx, cy), _turn(ax, ay, x, y, cx, cy), _turn(ax, ay, bx, by, x, y)


@compiled
def nearest_corners(areas, corners):
    """Return a point's nearest and second corner, and two of its barycentric coordinates.

    The third one, 0 on a cell's border half way between vertices and 1/3 at one; by how much the first
    exceeds the second, 0 on the border and 1 at the site.
    """
    one, two, three = areas
    k0, k1, k2 = corners
    if one < two:
        one, two, k0, k1 = two, one, k1, k0
    if two < three:
        two, three, k1, k2 = three, two, k2, k1
        if one < two:
            one, two, k0, k1 = two, one, k1, k0
    total = one + two + three
    return k0, k1, three / total, (one - two) / total


@compiled
def edge_relief(relief, site_relief, triangle, beyond, corners):
    """Return the relief (m) at the middle of an edge between two triangles, or beside it if it is less there.

    An edge that rises more than the ground on either side can is a dam.
    """
    row, column, half = triangle
    q, p, other = beyond
    first = site_relief[row + CORNER_Y[corners[0]], column + CORNER_X[corners[0]]]
    second = site_relief[row + CORNER_Y[corners[1]], column + CORNER_X[corners[1]]]
    middle = 0.25 * (first + second + relief[row, column, half] + relief[q, p, other])
    return min(middle, 0.5 * (middle + min(first, second)))


class PassRule(NamedTuple):
    """How high passes are."""

    rise: float  # above the higher vertex, over the relief
    low_rise: float  # … and at most above the lowest vertex of either cell
    slope: float  # … and above either vertex: slope over relief (1/m) where that is small, below 1
    length: float  # of L, m


@compiled
def _centroid(table, origin, triangle):
    """Return the centroid of a triangle, in L from a lattice point near it."""
    row, column, half = triangle
    x = y = 0.0
    for k in range(3):
        corner = CORNERS[table.diagonal[row, column], half, k]
        j, i = row + CORNER_Y[corner], column + CORNER_X[corner]
        x += i - origin[1] + table.site_x[j, i]
        y += j - origin[0] + table.site_y[j, i]
    return x / 3.0, y / 3.0


@compiled
def pass_height(table, triangle, beyond, corners, rule):
    """Return the height (m) of the pass half way between two vertices."""
    row, column, half = triangle
    q, p, other = beyond
    here, there = table.height[row, column, half], table.height[q, p, other]
    relief = edge_relief(table.relief, table.site_relief, triangle, beyond, corners)
    top = max(here, there) + rule.rise * relief
    x = y = 0.0
    for k in range(2):
        j, i = row + CORNER_Y[corners[k]], column + CORNER_X[corners[k]]
        top = min(top, table.site_low[j, i] + rule.low_rise * 0.5 * (relief + table.site_relief[j, i]))
        x, y = x + 0.5 * (i - column + table.site_x[j, i]), y + 0.5 * (j - row + table.site_y[j, i])
    slope = rule.slope * relief
    slope *= rule.length / (1.0 + slope)
    ax, ay = _centroid(table, (row, column), triangle)
    bx, by = _centroid(table, (row, column), beyond)
    top = min(top, here + slope * sqrt((x - ax) * (x - ax) + (y - ay) * (y - ay)))
    top = min(top, there + slope * sqrt((x - bx) * (x - bx) + (y - by) * (y - by)))
    return max(top, here, there)


@compiled
def edge_inflow(table, triangle, corners):
    """Return the area (L²) that drains into the edge between two corners' cells from its upper end."""
    row, column, half = triangle
    side = quad_side(corners[0], corners[1])
    if table.receiver[row, column, half] == side:
        return 0.5 * table.upstream[row, column, half]
    q, p, other = neighbour(table.diagonal, row, column, half, side)
    if table.receiver[q, p, other] == (4 if side == 4 else (side + 2) % 4):
        return 0.5 * table.upstream[q, p, other]
    return 0.0


@compiled
def edge_height(table, triangle, corners, third, rule):
    """Return the height (m) of the edge between two corners' cells, by the third barycentric coordinate.

    A valley falls monotonously from vertex to vertex; any other edge rises to a pass half way.
    """
    row, column, half = triangle
    side = quad_side(corners[0], corners[1])
    q, p, other = neighbour(table.diagonal, row, column, half, side)
    here, there = table.height[row, column, half], table.height[q, p, other]
    t = min(max(0.5 - 1.5 * third, 0.0), 0.5)  # of the way to the other vertex
    back = 4 if side == 4 else (side + 2) % 4  # the side of the other triangle that leads back
    if table.receiver[row, column, half] == side or table.receiver[q, p, other] == back:
        low, high = (here, there) if here < there else (there, here)
        s = t if here < there else 1.0 - t
        return low + (high - low) * s * (0.6 + 0.4 * s)
    top = pass_height(table, triangle, (q, p, other), corners, rule)
    s = 2.0 * t
    return here + (top - here) * s * (1.3 - 0.3 * s)
