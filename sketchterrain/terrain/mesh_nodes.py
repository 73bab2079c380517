"""Mesh cells on the raster of nodes: owners of nodes, heights of borders, copying of drained cells."""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

import numpy as np
from numba import njit

from sketchterrain.terrain.mesh import (
    CORNER_X,
    CORNER_Y,
    SIDE,
    SITE_BITS,
    edge_height,
    edge_inflow,
    locate,
)

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def owners(mesh, table, level, column, row, rows, columns):
    """Return the triangle, corners and third coordinate of each node; the corner 0 is its cell's site."""
    place = np.empty((rows, columns, 5), np.int32)
    third = np.empty((rows, columns))
    for j in range(rows):
        for i in range(columns):
            q, p, half, first, second, rest, _ = locate(
                mesh, table, ((column + i) << level) * SIDE, ((row + j) << level) * SIDE
            )
            place[j, i, 0], place[j, i, 1], place[j, i, 2] = q, p, half
            place[j, i, 3], place[j, i, 4] = first, second
            third[j, i] = rest
    return place, third


@_compiled
def mesh_heights(mesh, table, level, column, row, rows, columns, rule, rise):
    """Return heights (m) of nodes between the edges of their cells and crests at the sites.

    Crests rise above the edges by shares of the relief at the site.
    """
    height = np.empty((rows, columns))
    for j in range(rows):
        for i in range(columns):
            q, p, half, first, second, third, away = locate(
                mesh, table, ((column + i) << level) * SIDE, ((row + j) << level) * SIDE
            )
            edge = edge_height(table, (q, p, half), (first, second), third, rule)
            site = q + CORNER_Y[first], p + CORNER_X[first]
            crest = table.site_low[site] + rise * table.site_relief[site]
            height[j, i] = edge + (max(crest, edge) - edge) * away * (2.0 - away)
    return height


@_compiled
def owner_index(place, stride):
    """Return each node's cell: row · stride + column of its site in the table."""
    rows, columns = place.shape[:2]
    owner = np.empty((rows, columns), np.int32)
    for j in range(rows):
        for i in range(columns):
            first = place[j, i, 3]
            owner[j, i] = (place[j, i, 0] + CORNER_Y[first]) * stride + place[j, i, 1] + CORNER_X[first]
    return owner


@_compiled
def borders(table, place, third, owner, rule):
    """Return heights of edges and areas (L²) that drain into them from above, at nodes of borders.

    These have an 8-neighbour of another cell; others get NaN and 0.
    """
    rows, columns = owner.shape
    base, inflow = np.full((rows, columns), np.nan), np.zeros((rows, columns))
    for j in range(1, rows - 1):
        for i in range(1, columns - 1):
            border = False
            for b in range(-1, 2):
                for a in range(-1, 2):
                    if owner[j + b, i + a] != owner[j, i]:
                        border = True
            if border:
                q, p, half, first, second = place[j, i]
                base[j, i] = edge_height(table, (q, p, half), (first, second), third[j, i], rule)
                inflow[j, i] = edge_inflow(table, (q, p, half), (first, second))
    return base, inflow


@_compiled
def outer_borders(inside, base):
    """Return the heights of nodes with an 8-neighbour outside, NaN elsewhere."""
    rows, columns = inside.shape
    result = np.full((rows, columns), np.nan)
    for j in range(1, rows - 1):
        for i in range(1, columns - 1):
            if inside[j, i] and not inside[j - 1 : j + 2, i - 1 : i + 2].all():
                result[j, i] = base[j, i]
    return result


@_compiled
def boxes(owner, count):
    """Return first row, first column, end row, end column of each cell; 0 of one without nodes."""
    boxes = np.zeros((count, 4), np.int64)
    for j in range(owner.shape[0]):
        for i in range(owner.shape[1]):
            k = owner[j, i]
            if k < 0:
                continue
            if boxes[k, 2] == 0:
                boxes[k, 0], boxes[k, 1] = j, i
            boxes[k, 0], boxes[k, 1] = min(boxes[k, 0], j), min(boxes[k, 1], i)
            boxes[k, 2], boxes[k, 3] = max(boxes[k, 2], j + 1), max(boxes[k, 3], i + 1)
    return boxes


@_compiled
def pile_talus(height, base, step):
    """Raise ground below passes that stand above it until it is no steeper than talus (in place)."""
    rows, columns = height.shape
    for turn in range(2):
        for a in range(rows):
            for b in range(columns):
                j, i = (a, b) if turn == 0 else (rows - 1 - a, columns - 1 - b)
                if base[j, i] == base[j, i]:
                    continue
                for q, p, reach in ((-1, -1, 1.4142), (-1, 0, 1.0), (-1, 1, 1.4142), (0, -1, 1.0)):
                    y, x = (j + q, i + p) if turn == 0 else (j - q, i - p)
                    if (
                        0 <= y < rows
                        and 0 <= x < columns
                        and height[y, x] - step[j, i] * reach > height[j, i]
                    ):
                        height[j, i] = height[y, x] - step[j, i] * reach


@_compiled
def paste(owner, number, window, cell, corner):
    """Copy the nodes of a cell into a window's heights, areas and wetness; its first is `corner` there."""
    rows, columns = cell[0].shape
    row, column = corner
    for j in range(max(row, 0), min(row + rows, owner.shape[0])):
        for i in range(max(column, 0), min(column + columns, owner.shape[1])):
            if owner[j, i] == number:
                window[0][j, i] = cell[0][j - row, i - column]
                window[1][j, i] = cell[1][j - row, i - column]
                window[2][j, i] = cell[2][j - row, i - column]


def quads_of_nodes(level: int, column: int, row: int, rows: int, columns: int) -> tuple[int, int, int, int]:
    """Return first column, first row, rows and columns of the quads that nodes of a window can lie in."""
    west, south = ((column << level) >> SITE_BITS) - 3, ((row << level) >> SITE_BITS) - 3
    east = ((column + columns - 1) << level) >> SITE_BITS
    north = ((row + rows - 1) << level) >> SITE_BITS
    return west, south, north - south + 3, east - west + 3
