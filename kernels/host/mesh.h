/* Mesh of drainage cells: an unbounded, irregular partition of the plane whose edges are valleys and passes.
 *
 * Sites of a jittered square lattice of spacing L are triangulated by the shorter diagonal of every quad. A
 * triangle's centroid is a mesh vertex; a point belongs to the site of its greatest barycentric coordinate.
 * Mesh units are L/1024. Sides of quads: 0 south, 1 east, 2 north, 3 west, 4 the diagonal; corners:
 * 0 south-west, 1 south-east, 2 north-east, 3 north-west; diagonals: 0 between corners 0 and 2, 1 between
 * corners 1 and 3.
 */
#pragma once

#include "host.h"

#define UNIT_BITS 10 /* of the mesh units along L */
#define SITE_BITS 6 /* of the nodes of level 0 along L */
enum {
    UNIT = 1 << UNIT_BITS,
    SIDE = 1 << (UNIT_BITS - SITE_BITS), /* mesh units between nodes of level 0 */
};

/* What the mesh depends on besides the fields of uplift: hash states and gradients. */
typedef struct {
    uint64_t jitter;
    uint64_t warp_x;
    uint64_t warp_y;
    uint64_t sway;
    double fall; /* of a trunk valley along L, m */
    double east; /* direction of the tilt */
    double north;
    double phase; /* of both waves of the tilt, 0 … 1 */
    double across_phase;
} MeshParameters;

/* Sites and vertices of a rectangle of quads. */
typedef struct {
    int64_t rows; /* of quads */
    int64_t columns;
    int64_t column; /* of the first quad */
    int64_t row;
    const double *site_x; /* [rows + 1][columns + 1], offset from the lattice point, L */
    const double *site_y; /* [rows + 1][columns + 1] */
    const int64_t *diagonal; /* [rows][columns] */
    const double *height; /* [rows][columns][2], of vertices, m */
    const int64_t *receiver; /* [rows][columns][2], side, -1 none */
    const int64_t *upstream; /* [rows][columns][2], vertices that drain through this one, itself included */
    const double *relief; /* [rows][columns][2], of the ground at vertices, m */
    const double *site_relief; /* [rows + 1][columns + 1], of the ground at sites, m */
    const double *site_low; /* [rows + 1][columns + 1], height of the lowest vertex around sites, m */
} MeshTable;

/* How high passes are. */
typedef struct {
    double rise; /* above the higher vertex, over the relief */
    double low_rise; /* … and at most above the lowest vertex of either cell */
    double slope; /* … and above either vertex: slope over relief (1/m) where that is small, below 1 */
    double length; /* of L, m */
} PassRule;

/* A half of a quad: with its south side (0) or its north side (1). */
typedef struct {
    int64_t row, column, half;
} Triangle;

/* Corners of triangles by diagonal and half, and their places. */
static const int64_t CORNERS[2][2][3] = {{{0, 1, 2}, {0, 2, 3}}, {{0, 1, 3}, {1, 2, 3}}};
static const int64_t CORNER_X[4] = {0, 1, 1, 0}, CORNER_Y[4] = {0, 0, 1, 1};

static inline int64_t vertex_index(const MeshTable *table, Triangle at)
{
    return 2 * (at.row * table->columns + at.column) + at.half;
}

static inline int64_t site_index(const MeshTable *table, int64_t row, int64_t column, int64_t corner)
{
    return (row + CORNER_Y[corner]) * (table->columns + 1) + column + CORNER_X[corner];
}

static inline const int64_t *triangle_numbers(const MeshTable *table, Triangle at)
{
    return CORNERS[table->diagonal[at.row * table->columns + at.column]][at.half];
}

/* Twice the signed area of a triangle. */
static inline double turn(double ax, double ay, double bx, double by, double cx, double cy)
{
    return (bx - ax) * (cy - ay) - (cx - ax) * (by - ay);
}

/* x and y of a triangle's corners, in L from the lattice point of its quad. */
static inline void triangle_corners(const MeshTable *table, Triangle at, double corner[6])
{
    const int64_t *number = triangle_numbers(table, at);
    for (int64_t k = 0; k < 3; k++) {
        int64_t site = site_index(table, at.row, at.column, number[k]);
        corner[2 * k] = (double)CORNER_X[number[k]] + table->site_x[site];
        corner[2 * k + 1] = (double)CORNER_Y[number[k]] + table->site_y[site];
    }
}

/* Twice the signed areas of a point's triangles with the sides opposite to each corner. */
static inline void corner_areas(const double corner[6], double x, double y, double area[3])
{
    double ax = corner[0], ay = corner[1], bx = corner[2], by = corner[3], cx = corner[4], cy = corner[5];
    area[0] = turn(x, y, bx, by, cx, cy);
    area[1] = turn(ax, ay, x, y, cx, cy);
    area[2] = turn(ax, ay, bx, by, x, y);
}

/* The triangle beyond a side; its row is -1 if the table ends there. */
static inline Triangle neighbour(const MeshTable *table, Triangle at, int64_t side)
{
    const int64_t *diagonal = table->diagonal + at.row * table->columns + at.column;
    if (side == 4)
        return (Triangle){at.row, at.column, 1 - at.half};
    if (side == 0)
        return (Triangle){at.row - 1, at.column, 1};
    if (side == 2)
        return (Triangle){at.row + 1 < table->rows ? at.row + 1 : -1, at.column, 0};
    if (side == 1 && at.column + 1 < table->columns)
        return (Triangle){at.row, at.column + 1, 1 - diagonal[1]};
    if (side == 3 && at.column > 0)
        return (Triangle){at.row, at.column - 1, diagonal[-1]};
    return (Triangle){-1, at.column, 0};
}

/* A side of a triangle by its number, 0 … 2: two of the quad, and the diagonal. */
static inline int64_t triangle_side(const MeshTable *table, Triangle at, int64_t number)
{
    static const int64_t sides[2][2][3] = {{{0, 1, 4}, {2, 3, 4}}, {{0, 3, 4}, {2, 1, 4}}};
    return sides[table->diagonal[at.row * table->columns + at.column]][at.half][number];
}

/* Relief (m) at the middle of an edge between two triangles, or beside it if it is less there: an edge that
 * rises more than the ground on either side can is a dam. Its ends are the corners `first` and `second`. */
static inline double edge_relief(
    const MeshTable *table, Triangle at, Triangle beyond, int64_t first, int64_t second)
{
    double one = table->site_relief[site_index(table, at.row, at.column, first)];
    double two = table->site_relief[site_index(table, at.row, at.column, second)];
    double here = table->relief[vertex_index(table, at)], there = table->relief[vertex_index(table, beyond)];
    double middle = 0.25 * (one + two + here + there);
    return least(middle, 0.5 * (middle + least(one, two)));
}

/* Height (m) of trunk valleys at a point (mesh units): waves of a tilt, sway, and the sketch's swell. */
double base_level(const MeshParameters *mesh, int64_t x, int64_t y);

/* Area (L²) that drains into the edge between two corners' cells from its upper end. */
double edge_inflow(const MeshTable *table, Triangle at, int64_t first, int64_t second);

/* Offsets of sites (L) and diagonals of quads, from site (column, row) on. */
HOST void lattice_sites(
    const MeshParameters *mesh, int64_t column, int64_t row, int64_t rows, int64_t columns,
    double x[restrict rows + 1][columns + 1], double y[restrict rows + 1][columns + 1],
    int64_t diagonal[restrict rows][columns]);

/* Height (m) of the edge between two corners' cells, by the third barycentric coordinate. A valley falls
 * monotonously from vertex to vertex; any other edge rises to a pass half way. */
HOST double edge_height(
    const MeshTable *table, const PassRule *rule, int64_t row, int64_t column, int64_t half,
    int64_t first, int64_t second, double third);

/* Height (m) of the lowest vertex around each site. */
HOST void lowest_around_sites(
    int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const double height[restrict rows][columns][2], /* m */
    double low[restrict rows + 1][columns + 1]);
