"""Mesh cells on the raster of nodes: owners of nodes, heights of borders, draining and copying of cells."""

from typing import NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array, Int32Array, Int64Array
from sketchterrain.host.library import host_function
from sketchterrain.landforms.mesh import CORNER_X, CORNER_Y, SITE_BITS, MeshParameters, MeshTable


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


def owners(
    mesh: MeshParameters, table: MeshTable, level: int, column: int, row: int, rows: int, columns: int
) -> tuple[Int32Array, Float64Array, Float64Array]:
    """Return the triangle and nearest corners of each node, and two barycentric coordinates of it.

    The first corner is the site of the node's cell. The third coordinate is 0 on a cell's border half way
    between vertices and 1/3 at one; the first exceeds the second by the last number, 0 on the border and 1
    at the site.
    """
    place, third = np.empty((rows, columns, 5), np.int32), np.empty((rows, columns))
    away, scratch = np.empty((rows, columns)), np.empty((2, columns))
    host_function("node_places")(mesh, table, level, column, row, place, third, away, scratch)
    return place, third, away


def owner_index(place: Int32Array, stride: int) -> Int64Array:
    """Return each node's cell: row · stride + column of its site in the table."""
    row, column, _, first, _ = np.moveaxis(place, -1, 0)
    return np.asarray((row + CORNER_Y[first]) * stride + column + CORNER_X[first])


def quads_of_nodes(level: int, column: int, row: int, rows: int, columns: int) -> tuple[int, int, int, int]:
    """Return first column, first row, rows and columns of the quads that nodes of a window can lie in."""
    west, south = ((column << level) >> SITE_BITS) - 3, ((row << level) >> SITE_BITS) - 3
    east = ((column + columns - 1) << level) >> SITE_BITS
    north = ((row + rows - 1) << level) >> SITE_BITS
    return west, south, north - south + 3, east - west + 3
