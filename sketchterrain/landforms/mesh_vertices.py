"""Heights of mesh vertices, which make the mesh's edges valleys or passes.

Vertices drain to a neighbour that is lower on the base level, a field without minima for scores of L: a
forest of trunk valleys at the base level and of tributaries that rise from them by stream power. A height
depends on vertices at most `MARGIN` quads away, since tributaries have less than `TRUNK` vertices.
"""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from math import floor, sqrt

import numpy as np

from sketchterrain.landforms.hashed_noise import compiled
from sketchterrain.landforms.mesh import (
    CORNER_X,
    CORNER_Y,
    CORNERS,
    SITE_BITS,
    UNIT_BITS,
    base_level,
    edge_relief,
    neighbour,
    side_corners,
    triangle_corners,
    triangle_sides,
)

TRUNK = 32  # vertices upstream from which on a valley is a trunk at the base level
BLOCK = 128  # quads along a block of the vertex table; the sketch is in the middle of one
MARGIN = 2 * TRUNK + 12  # quads that can influence a vertex: upstream of its way down to the trunk
_AVOIDANCE = 0.5  # share of the relief that valleys avoid
_CEILING = 0.6  # greatest height of a vertex above the base level, over the relief upstream
CAPTURES = 6  # edges across which a lower valley draws others down
_CAPTURE_SLOPE = 0.06  # … rising with this slope over uplift
_KEPT_FALL, _RISE_SLOPE = 0.75, 0.12  # of raised valleys: share of their fall, slope added to tributaries
_REPAIRS = 4  # rounds of lifting sinks above their lowest neighbour


@compiled
def vertices(mesh, column, row, x, y, diagonal):
    """Return the centroids of triangles, and the points where their base level is read; mesh units."""
    rows, columns = diagonal.shape
    centre, probe = np.empty((rows, columns, 2, 2), np.int64), np.empty((rows, columns, 2, 2), np.int64)
    unit_length = float(1 << UNIT_BITS)
    for j, i, half in np.ndindex(rows, columns, 2):
        ax, ay, bx, by, cx, cy = triangle_corners(diagonal, x, y, j, i, half)
        mx, my = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0
        ux, uy, vx, vy = bx - ax, by - ay, cx - ax, cy - ay
        area = 2.0 * (ux * vy - uy * vx)
        uu, vv = ux * ux + uy * uy, vx * vx + vy * vy
        qx, qy = ax + (vy * uu - uy * vv) / area, ay + (ux * vv - vx * uu) / area
        centre[j, i, half, 0] = ((column + i) << UNIT_BITS) + floor(mx * unit_length)
        centre[j, i, half, 1] = ((row + j) << UNIT_BITS) + floor(my * unit_length)
        qx, qy = min(max(qx, mx - 1.5), mx + 1.5), min(max(qy, my - 1.5), my + 1.5)
        probe[j, i, half, 0] = ((column + i) << UNIT_BITS) + floor(qx * unit_length)
        probe[j, i, half, 1] = ((row + j) << UNIT_BITS) + floor(qy * unit_length)
    return centre, probe


@compiled
def receivers(mesh, diagonal, probe, relief):
    """Return base levels of vertices, sinks lifted where a neighbour is hardly higher, and receivers.

    A vertex drains to a neighbour of lower base level, to that where the ground is lowest.
    """
    rows, columns = diagonal.shape
    level = np.empty((rows, columns, 2))
    for j, i, half in np.ndindex(rows, columns, 2):
        level[j, i, half] = base_level(mesh, probe[j, i, half, 0], probe[j, i, half, 1])
    receiver = np.empty((rows, columns, 2), np.int64)
    least = 0.02 * mesh.fall
    for repair in range(_REPAIRS + 1):
        lifted = level.copy()
        for j, i, half in np.ndindex(rows, columns, 2):
            lowest, least_ground, best = np.inf, np.inf, -1
            for side in triangle_sides(diagonal[j, i], half):
                q, p, other = neighbour(diagonal, j, i, half, side)
                if q < 0:
                    continue
                lowest = min(lowest, level[q, p, other])
                ground = level[q, p, other] + _AVOIDANCE * relief[q, p, other]
                if level[q, p, other] < level[j, i, half] and ground < least_ground:
                    least_ground, best = ground, side
            receiver[j, i, half] = best
            if lowest >= level[j, i, half] and lowest - level[j, i, half] < mesh.fall:
                lifted[j, i, half] = lowest + least
        if repair < _REPAIRS:
            level = lifted
    return level, receiver


@compiled
def _distance(centre, one, other):
    """Return the distance between two vertices, mesh units."""
    (j, i, half), (q, p, beyond) = one, other
    dx = np.float64(centre[q, p, beyond, 0] - centre[j, i, half, 0])
    dy = np.float64(centre[q, p, beyond, 1] - centre[j, i, half, 1])
    return sqrt(dx * dx + dy * dy)


@compiled
def _downstream(diagonal, centre, receiver, at):
    """Return the flat index of the vertex that one drains to, −1 for none, and the way there, mesh units."""
    columns, half = diagonal.shape[1], at & 1
    j, i = (at >> 1) // columns, (at >> 1) % columns
    side = receiver[j, i, half]
    if side < 0:
        return -1, 0.0
    q, p, other = neighbour(diagonal, j, i, half, side)
    return ((q * columns + p) << 1) + other, _distance(centre, (j, i, half), (q, p, other))


@compiled
def vertex_heights(mesh, diagonal, centre, level, order, receiver, relief, power):
    """Return heights by stream power from the trunk upwards, and numbers of vertices upstream.

    Where a valley crosses a range that is higher than what drains through it, it is a gorge: no vertex stands
    higher above the base level than a share of the least relief upstream.

    Parameters
    ----------
    order : flat indices of vertices, from the highest level down
    power : uplift over relief (1/m), greatest slope, metres in a mesh unit
    """
    upstream = np.ones(order.size, np.int64)
    below, length = np.empty(order.size, np.int64), np.empty(order.size)
    for at in order:
        below[at], length[at] = _downstream(diagonal, centre, receiver, at)
        to = below[at]
        if to >= 0:
            upstream[to] = min(upstream[to] + upstream[at], TRUNK)
    flat, reliefs = level.ravel(), relief.ravel()
    least = 0.02 * mesh.fall
    ceiling = flat + _CEILING * reliefs
    for at in order:
        to = below[at]
        if to >= 0:
            ceiling[to] = min(ceiling[to], max(ceiling[at] - least, flat[to]))
    height = flat.copy()
    per_relief, cap, metres = power
    for k in range(order.size - 1, -1, -1):
        at = order[k]
        to = below[at]
        if to < 0 or upstream[at] >= TRUNK:
            continue
        area = upstream[at] * (0.5 * (1 << (2 * SITE_BITS)))
        quarter = sqrt(sqrt(area))
        slope = min(reliefs[at] * per_relief / (quarter * sqrt(quarter)), cap)
        height[at] = max(min(height[to] + slope * metres * length[at], ceiling[at]), height[to] + 0.5 * least)
    return height.reshape(level.shape), upstream.reshape(level.shape)


@compiled
def captured(mesh, diagonal, centre, height, relief, site_relief, power):
    """Return heights no higher than the ground can rise to from lower valleys beside, and final receivers.

    Low valleys capture high ones, across at most CAPTURES edges.
    """
    for _ in range(CAPTURES):
        height = _lowered(mesh, diagonal, centre, height, relief, site_relief, power)
    return height, lowest_neighbours(diagonal, height)


@compiled
def raised(diagonal, centre, height, order, receiver, rise, metres):
    """Return heights raised by at most `rise` (m), and final receivers; valleys fall along the old ones.

    A valley that enters raised land from lower land is a gorge, from which tributaries rise at `_RISE_SLOPE`.

    Parameters
    ----------
    order : flat indices of vertices, from the highest down
    metres : in a mesh unit
    """
    flat, rise = height.ravel(), rise.ravel().copy()
    below, most = np.empty(order.size, np.int64), np.empty(order.size)
    for at in order:
        to, length = _downstream(diagonal, centre, receiver, at)
        below[at], most[at] = to, _RISE_SLOPE * metres * length
        if to >= 0:
            rise[to] = min(rise[to], rise[at] + _KEPT_FALL * (flat[at] - flat[to]))
    result = flat.copy()
    for k in range(order.size - 1, -1, -1):
        at, to = order[k], below[order[k]]
        if to >= 0:
            rise[at] = min(rise[at], rise[to] + most[at])
        result[at] = flat[at] + rise[at]
    result = result.reshape(height.shape)
    return result, lowest_neighbours(diagonal, result)


@compiled
def _lowered(mesh, diagonal, centre, height, relief, site_relief, power):
    """Lower vertices to what the ground can rise to from their neighbours."""
    rows, columns = diagonal.shape
    per_relief, cap, metres = power
    result = height.copy()
    for j, i, half in np.ndindex(rows, columns, 2):
        for side in triangle_sides(diagonal[j, i], half):
            q, p, other = neighbour(diagonal, j, i, half, side)
            if q < 0:
                continue
            corners = side_corners(diagonal[j, i], side)
            beside = edge_relief(relief, site_relief, (j, i, half), (q, p, other), corners)
            slope = min(_CAPTURE_SLOPE * beside * per_relief, 2.0 * cap)
            rise = slope * metres * _distance(centre, (j, i, half), (q, p, other)) + 0.02 * mesh.fall
            result[j, i, half] = min(result[j, i, half], height[q, p, other] + rise)
    return result


@compiled
def lowest_neighbours(diagonal, height):
    """Return the side of each vertex's lowest neighbour, −1 where none is lower."""
    rows, columns = diagonal.shape
    receiver = np.full((rows, columns, 2), -1, np.int64)
    for j, i, half in np.ndindex(rows, columns, 2):
        lowest = height[j, i, half]
        for side in triangle_sides(diagonal[j, i], half):
            q, p, other = neighbour(diagonal, j, i, half, side)
            if q >= 0 and height[q, p, other] < lowest:
                lowest = height[q, p, other]
                receiver[j, i, half] = side
    return receiver


@compiled
def lowest_around_sites(diagonal, height):
    """Return the height of the lowest vertex around each site of a table."""
    rows, columns = diagonal.shape
    low = np.full((rows + 1, columns + 1), np.inf)
    for j, i, half, k in np.ndindex(rows, columns, 2, 3):
        corner = CORNERS[diagonal[j, i], half, k]
        site = j + CORNER_Y[corner], i + CORNER_X[corner]
        low[site] = min(low[site], height[j, i, half])
    return low
