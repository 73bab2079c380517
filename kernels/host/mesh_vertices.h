/* Heights of mesh vertices, which make the mesh's edges valleys or passes.
 *
 * Vertices drain to a neighbour that is lower on the base level: a forest of trunk valleys at the base level
 * and of tributaries that rise from them by stream power, slope = uplift / area^(3/8). Flat indices of
 * vertices are 2 (row · columns + column) + half; receivers are sides, as in mesh.h.
 */
#pragma once

#include "mesh.h"

/* Centroids of triangles, and the points where their base level is read; x and y in mesh units. */
HOST void mesh_vertices(
    int64_t column, int64_t row, int64_t rows, int64_t columns,
    const double site_x[restrict rows + 1][columns + 1], /* L */
    const double site_y[restrict rows + 1][columns + 1], /* L */
    const int64_t diagonal[restrict rows][columns], int64_t centre[restrict rows][columns][2][2],
    int64_t probe[restrict rows][columns][2][2]);

/* Base levels of vertices, sinks lifted where a neighbour is hardly higher, and receivers: of the neighbours
 * of lower base level, that where the ground is lowest. */
HOST void mesh_receivers(
    const MeshParameters *mesh, int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const int64_t probe[restrict rows][columns][2][2], /* mesh units */
    const double relief[restrict rows][columns][2], /* m */
    double level[restrict rows][columns][2], /* m */
    int64_t receiver[restrict rows][columns][2], double scratch[restrict rows][columns][2]);

/* Heights by stream power from the trunk upwards, and numbers of vertices upstream, at most `trunk`. Where a
 * valley crosses a range that is higher than what drains through it, it is a gorge: no vertex stands higher
 * above the base level than a share of the least relief upstream. */
HOST void mesh_vertex_heights(
    int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const int64_t centre[restrict rows][columns][2][2], /* mesh units */
    const double level[restrict 2 * rows * columns], /* m */
    const int64_t order[restrict 2 * rows * columns], /* from the highest level down */
    const int64_t receiver[restrict rows][columns][2],
    const double relief[restrict 2 * rows * columns], /* m */
    double fall, /* of a trunk valley along L, m */
    double per_relief, /* uplift over relief, 1/m */
    double cap, /* greatest slope */
    double metres, /* in a mesh unit */
    int64_t trunk,
    double height[restrict 2 * rows * columns], /* m */
    int64_t upstream[restrict 2 * rows * columns],
    int64_t below[restrict 2 * rows * columns], /* scratch */
    double scratch[restrict 2][2 * rows * columns]);

/* Heights no higher than the ground can rise to from lower valleys beside, and final receivers: low valleys
 * capture high ones, across a number of edges. */
HOST void captured_heights(
    int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const int64_t centre[restrict rows][columns][2][2], /* mesh units */
    const double height[restrict rows][columns][2], /* m */
    const double relief[restrict rows][columns][2], /* m */
    const double site_relief[restrict rows + 1][columns + 1], /* m */
    double fall, double per_relief, double cap, double metres, /* as above */
    int64_t captures,
    double lowered[restrict rows][columns][2], /* m */
    int64_t receiver[restrict rows][columns][2], double scratch[restrict rows][columns][2]);

/* Heights raised by at most `rise`, and final receivers; valleys fall along the old ones. A valley that
 * enters raised land from lower land is a gorge, from which tributaries rise steeply. */
HOST void raised_heights(
    int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const int64_t centre[restrict rows][columns][2][2], /* mesh units */
    const double height[restrict 2 * rows * columns], /* m */
    const int64_t order[restrict 2 * rows * columns], /* from the highest down */
    const int64_t course[restrict rows][columns][2], /* receivers before */
    double metres, /* in a mesh unit */
    double rise[restrict 2 * rows * columns], /* m; what is left of it on return */
    double raised[restrict 2 * rows * columns], /* m */
    int64_t receiver[restrict rows][columns][2],
    int64_t below[restrict 2 * rows * columns], /* scratch */
    double scratch[restrict 2 * rows * columns]);
