"""Mesh cells on the raster of nodes: owners of nodes, heights of borders, draining and copying of cells.

Loops stand instead of array expressions, which take numba seconds to compile.
"""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from typing import NamedTuple

import numpy as np
from scipy.ndimage import find_objects

from sketchterrain.array_types import Float64Array, Int32Array, Int64Array
from sketchterrain.landforms.drainage import FIRST_ROUNDS, FIRST_UPLIFT
from sketchterrain.landforms.drainage_levels import pack
from sketchterrain.landforms.drainage_rounds import new_state, run
from sketchterrain.landforms.hashed_noise import compiled
from sketchterrain.landforms.mesh import (
    CORNER_X,
    CORNER_Y,
    CORNERS,
    SIDE,
    SITE_BITS,
    WARP,
    border_warp_row,
    corner_areas,
    displaced,
    edge_height,
    edge_inflow,
    nearest_corners,
    triangle_at,
    triangle_corners,
)
from sketchterrain.landforms.wetness import wetness

_CLEARLY = 1e-6  # inside of a triangle, L²: in no other one, whatever is rounded


class CellNodes(NamedTuple):
    """Rasters of one level around some cells, rows northward from node (column, row).

    `owner` is a cell's number, −1 outside of them; `boxes` (n, 4) hold first row, first column, end row and
    end column of each, 0 of one without nodes.
    """

    level: int
    column: int
    row: int
    owner: Int32Array
    base: Float64Array  # heights (m) of nodes on borders, NaN elsewhere
    uplift: Float64Array
    repose: Float64Array
    inflow: Float64Array  # areas (m²) that drain from other cells into nodes on valleys between cells
    boxes: Int64Array


@compiled
def owners(mesh, table, level, column, row, rows, columns):
    """Return the triangle and nearest corners of each node, and its coordinates of `nearest_corners`.

    The first corner is the site of the node's cell.
    """
    place = np.empty((rows, columns, 5), np.int32)
    third, away = np.empty((rows, columns)), np.empty((rows, columns))
    east, north = np.empty(columns), np.empty(columns)
    x, step = (column << level) * SIDE, SIDE << level
    q = p = half = 0
    numbers, corners = CORNERS[0, 0], (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for j in range(rows):
        y = ((row + j) << level) * SIDE
        border_warp_row(mesh, x, step, y, east, north)
        for i in range(columns):
            r, c, px, py = displaced(table, x + i * step, y, east[i], north[i])
            areas = corner_areas(corners, px - (p - c), py - (q - r))
            if min(areas) < _CLEARLY:  # not in the triangle of the node before
                q, p, half = triangle_at(table, r, c, px, py)
                numbers = CORNERS[table.diagonal[q, p], half]
                corners = triangle_corners(table.diagonal, table.site_x, table.site_y, q, p, half)
                areas = corner_areas(corners, px - (p - c), py - (q - r))
            first, second, third[j, i], away[j, i] = nearest_corners(areas, numbers)
            here = place[j, i]
            here[0], here[1], here[2], here[3], here[4] = q, p, half, first, second
    return place, third, away


@compiled
def cell_bounds(table):
    """Return boxes (rows, columns, 4) of the cells of a table's inner sites: west, south, east, north, in L.

    From the table's first lattice point; a cell's border is displaced by up to `WARP`.
    """
    rows, columns = table.diagonal.shape
    bounds = np.zeros((rows, columns, 4))
    for j in range(1, rows):
        for i in range(1, columns):
            west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
            for q in range(j - 1, j + 1):
                for p in range(i - 1, i + 1):
                    for half in range(2):
                        x, y, own = np.empty(3), np.empty(3), -1
                        for k in range(3):
                            corner = CORNERS[table.diagonal[q, p], half, k]
                            r, c = q + CORNER_Y[corner], p + CORNER_X[corner]
                            x[k], y[k] = c + table.site_x[r, c], r + table.site_y[r, c]
                            if r == j and c == i:
                                own = k
                        if own < 0:
                            continue
                        for k in range(3):  # the middles of sides at the site, and the centroid
                            a = 0.5 * (x[own] + x[k]) if k != own else (x[0] + x[1] + x[2]) / 3.0
                            b = 0.5 * (y[own] + y[k]) if k != own else (y[0] + y[1] + y[2]) / 3.0
                            west, east = min(west, a), max(east, a)
                            south, north = min(south, b), max(north, b)
            bounds[j, i, 0], bounds[j, i, 1] = west - WARP, south - WARP
            bounds[j, i, 2], bounds[j, i, 3] = east + WARP, north + WARP
    return bounds


@compiled
def mesh_heights(mesh, table, level, column, row, rows, columns, rule, rise):
    """Return heights (m) of nodes between the edges of their cells and crests at the sites.

    Crests rise above the edges by shares of the relief at the site.
    """
    place, third, away = owners(mesh, table, level, column, row, rows, columns)
    height = np.empty((rows, columns))
    for j, i in np.ndindex(rows, columns):
        q, p, half, first, second = place[j, i]
        edge = edge_height(table, (q, p, half), (first, second), third[j, i], rule)
        site = q + CORNER_Y[first], p + CORNER_X[first]
        crest = table.site_low[site] + rise * table.site_relief[site]
        height[j, i] = edge + (max(crest, edge) - edge) * away[j, i] * (2.0 - away[j, i])
    return height


@compiled
def borders(table, place, third, owner, rule):
    """Return heights of edges and areas (m²) that drain into them from above, at nodes of borders.

    These have an 8-neighbour of another cell; others, and those of no cell, get NaN and 0.
    """
    rows, columns = owner.shape
    base, inflow = np.full((rows, columns), np.nan), np.zeros((rows, columns))
    for j in range(1, rows - 1):
        south, here, north = owner[j - 1], owner[j], owner[j + 1]
        for i in range(columns - 2):
            own = here[i + 1]
            beside = (here[i] ^ own) | (here[i + 2] ^ own) | (south[i + 1] ^ own) | (north[i + 1] ^ own)
            across = (south[i] ^ own) | (south[i + 2] ^ own) | (north[i] ^ own) | (north[i + 2] ^ own)
            if own >= 0 and beside | across:
                q, p, half, first, second = place[j, i + 1]
                base[j, i + 1] = edge_height(table, (q, p, half), (first, second), third[j, i + 1], rule)
                area = edge_inflow(table, (q, p, half), (first, second))
                inflow[j, i + 1] = area * (rule.length * rule.length)
    return base, inflow


@compiled
def drain_cell(cells, number, coarser, corner, cell, rounds, talus):
    """Drain a cell alone, as `drainage.drain` does; return what `_Cell` has of its box.

    Heights (m), heights with talus, areas (m²) and wetness.

    Parameters
    ----------
    cells, number : rasters of the level, and the cell's number in them
    coarser : drained heights (m) of the next coarser level, NaN outside of the cell; empty at the first one
    corner : row and column of its first node, in nodes of that level
    cell : spacing of level 0, m
    rounds : rounds of routing and integrating
    talus : greatest slope below passes, over that of hillslopes
    """
    south, west, north, east = cells.boxes[number]
    part = slice(south, north), slice(west, east)
    rows, columns = north - south, east - west
    shape = rows, columns
    domain, base = np.empty(shape, np.bool_), np.full(shape, np.nan)
    for i, j in np.ndindex(rows, columns):
        domain[i, j] = cells.owner[south + i, west + j] == number
        if domain[i, j]:
            base[i, j] = cells.base[south + i, west + j]
    size = (rows + 2) * (columns + 2)
    spacing = cell * 2.0**cells.level
    kinds, forced = np.zeros(size, np.int8), np.full(size, -1, np.int32)
    uplift, repose, rains = np.zeros(size), np.zeros(size), np.zeros(size)
    state = new_state(size)
    rain, free = np.full(shape, spacing * spacing), np.full(shape, -1, np.int32)
    pack(
        (cells.uplift[part].copy(), cells.repose[part].copy(), rain, base),
        (domain, free, (cells.row + south, cells.column + west), cells.level),
        (coarser, corner, spacing, np.empty((0, 0))),
        (uplift, repose, rains, state[0]),
        (kinds, forced),
    )
    fields = uplift, repose, rains, np.full(size, -np.inf), np.zeros(size)
    topology, geometry = (kinds, forced), (columns + 2, spacing, 1.0 / (cell * cell))
    if coarser.size == 0:
        even = np.full(size, FIRST_UPLIFT), *fields[1:]
        run(topology, even, state, geometry, np.int64(FIRST_ROUNDS))  # a literal would be compiled anew
    run(topology, fields, state, geometry, rounds)
    height, area, narrow = np.full(shape, np.nan), np.zeros(shape), np.zeros(shape, np.float32)
    for i, j in np.ndindex(rows, columns):
        if domain[i, j]:
            at = (i + 1) * (columns + 2) + j + 1
            height[i, j] = state[0][at]
            area[i, j] = state[1][at] + cells.inflow[south + i, west + j]
            narrow[i, j] = area[i, j]
    piled = height.copy()
    _pile_talus(piled, base, cells.repose[part], talus * spacing)
    return height, piled, narrow, wetness(piled, area, spacing, cell)


@compiled
def _pile_talus(height, base, repose, slope):
    """Raise ground below passes that stand above it until it is no steeper than talus (in place)."""
    rows, columns = height.shape
    for turn, a, b in np.ndindex(2, rows, columns):
        j, i = (a, b) if turn == 0 else (rows - 1 - a, columns - 1 - b)
        if base[j, i] == base[j, i] or height[j, i] != height[j, i]:
            continue
        step = slope * repose[j, i]
        for q, p, reach in ((-1, -1, 1.4142), (-1, 0, 1.0), (-1, 1, 1.4142), (0, -1, 1.0)):
            y, x = (j + q, i + p) if turn == 0 else (j - q, i - p)
            if 0 <= y < rows and 0 <= x < columns and height[y, x] - step * reach > height[j, i]:
                height[j, i] = height[y, x] - step * reach


@compiled
def paste(window, cell, corner):
    """Copy the nodes of a cell into a window's heights, areas and wetness; its first is `corner` there."""
    rows, columns = cell[0].shape
    row, column = corner
    for j in range(max(row, 0), min(row + rows, window[0].shape[0])):
        for i in range(max(column, 0), min(column + columns, window[0].shape[1])):
            if cell[0][j - row, i - column] == cell[0][j - row, i - column]:
                window[0][j, i] = cell[0][j - row, i - column]
                window[1][j, i] = cell[1][j - row, i - column]
                window[2][j, i] = cell[2][j - row, i - column]


def owner_index(place: Int32Array, stride: int) -> Int64Array:
    """Return each node's cell: row · stride + column of its site in the table."""
    row, column, _, first, _ = np.moveaxis(place, -1, 0)
    return np.asarray((row + CORNER_Y[first]) * stride + column + CORNER_X[first])


def boxes(owner: Int32Array, count: int) -> Int64Array:
    """Return first row, first column, end row, end column of each cell; 0 of one without nodes."""
    found = np.zeros((count, 4), np.int64)
    for number, box in enumerate(find_objects(owner + 1, max_label=count)):
        if box is not None:
            found[number] = box[0].start, box[1].start, box[0].stop, box[1].stop
    return found


def quads_of_nodes(level: int, column: int, row: int, rows: int, columns: int) -> tuple[int, int, int, int]:
    """Return first column, first row, rows and columns of the quads that nodes of a window can lie in."""
    west, south = ((column << level) >> SITE_BITS) - 3, ((row << level) >> SITE_BITS) - 3
    east = ((column + columns - 1) << level) >> SITE_BITS
    north = ((row + rows - 1) << level) >> SITE_BITS
    return west, south, north - south + 3, east - west + 3
