"""Heights of mesh vertices, which make the mesh's edges valleys or passes.

Vertices drain to a neighbour that is lower on the base level, a field without minima for scores of L: a
forest of trunk valleys at the base level and of tributaries that rise from them by stream power. A height
depends on vertices at most `MARGIN` quads away, since tributaries have less than `TRUNK` vertices.
"""

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.host.library import host_function
from sketchterrain.landforms.mesh import MeshParameters

TRUNK = 32  # vertices upstream from which on a valley is a trunk at the base level
BLOCK = 128  # quads along a block of the vertex table; the sketch is in the middle of one
MARGIN = 2 * TRUNK + 12  # quads that can influence a vertex: upstream of its way down to the trunk
CAPTURES = 6  # edges across which a lower valley draws others down


def vertices(
    column: int, row: int, x: Float64Array, y: Float64Array, diagonal: Int64Array
) -> tuple[Int64Array, Int64Array]:
    """Return the centroids of triangles, and the points where their base level is read; mesh units."""
    centre, probe = np.empty((*diagonal.shape, 2, 2), np.int64), np.empty((*diagonal.shape, 2, 2), np.int64)
    host_function("mesh_vertices")(column, row, x, y, diagonal, centre, probe)
    return centre, probe


def receivers(
    mesh: MeshParameters, diagonal: Int64Array, probe: Int64Array, relief: Float64Array
) -> tuple[Float64Array, Int64Array]:
    """Return base levels of vertices, sinks lifted where a neighbour is hardly higher, and receivers."""
    level, receiver = np.empty(relief.shape), np.empty(relief.shape, np.int64)
    host_function("mesh_receivers")(mesh, diagonal, probe, relief, level, receiver, np.empty(relief.shape))
    return level, receiver


def vertex_heights(
    diagonal: Int64Array,
    centre: Int64Array,
    level: Float64Array,
    receiver: Int64Array,
    relief: Float64Array,
    slopes: tuple[float, float, float, float],
) -> tuple[Float64Array, Int64Array]:
    """Return heights by stream power from the trunk upwards, and numbers of vertices upstream.

    `slopes` are the fall of a trunk along L (m), uplift over relief (1/m), the greatest slope, and the length
    of a mesh unit (m).
    """
    flat = level.ravel()
    order = np.argsort(-flat, kind="stable")
    height, upstream, below = (
        np.empty(flat.size),
        np.empty(flat.size, np.int64),
        np.empty(flat.size, np.int64),
    )
    given = diagonal, centre, flat, order, receiver, relief.ravel(), *slopes, TRUNK
    host_function("mesh_vertex_heights")(*given, height, upstream, below, np.empty((2, flat.size)))
    return height.reshape(level.shape), upstream.reshape(level.shape)


def captured(
    diagonal: Int64Array,
    centre: Int64Array,
    height: Float64Array,
    relief: Float64Array,
    site_relief: Float64Array,
    slopes: tuple[float, float, float, float],
) -> tuple[Float64Array, Int64Array]:
    """Return heights no higher than the ground can rise to from lower valleys beside, and final receivers."""
    lowered, receiver = np.empty(height.shape), np.empty(height.shape, np.int64)
    given = diagonal, centre, height, relief, site_relief, *slopes, CAPTURES
    host_function("captured_heights")(*given, lowered, receiver, np.empty(height.shape))
    return lowered, receiver


def raised(
    diagonal: Int64Array,
    centre: Int64Array,
    height: Float64Array,
    course: Int64Array,
    rise: Float64Array,
    metres: float,
) -> tuple[Float64Array, Int64Array]:
    """Return heights raised by at most `rise` (m), and final receivers; valleys fall along `course`."""
    flat = height.ravel()
    order = np.argsort(-flat, kind="stable")
    result, receiver = np.empty(flat.size), np.empty(height.shape, np.int64)
    given = diagonal, centre, flat, order, course, metres, rise.flatten()
    scratch = np.empty(flat.size, np.int64), np.empty(flat.size)
    host_function("raised_heights")(*given, result, receiver, *scratch)
    return result.reshape(height.shape), receiver
