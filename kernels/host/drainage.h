/* Drained relief on rasters: the steady state of stream power with slopes below repose.
 *
 * z = z_receiver + S d with S = (s^-4 + repose^-4)^(-1/4), s = u / (A / r0^2)^(3/8); rounds of routing and
 * integrating after Tzathas et al., "Physically-based analytical erosion for fast terrain generation" (2024);
 * passes of depressions after Cordonnier et al., "A versatile, linear complexity algorithm for flow routing
 * in topographies with depressions" (2019): Boruvka's minimum spanning tree of basins.
 */
#pragma once

#include "host.h"

#define LEAST_SLOPE 0.0001220703125 /* 2^-13, of a node to its receiver, where nothing is uplifted */
#define LEAST_RISE 1e-6 /* of a course, m */

/* A level in rasters with a margin of one node outside of the domain, where heights are infinite; nodes are
 * row * width + column of these. Donors come before their receivers in the order of flow. */
typedef struct {
    int64_t rows;
    int64_t width;
    double spacing; /* m */
    double per_area; /* 1 / r0^2 of the spacing r0 of level 0, 1/m^2 */
    /* Uplift (m/m), repose (m/m), rain (m^2), least height (m), strata (0 ... 1), height (m), area (m^2),
     * height before the last routing (m), rise to the node (m), and two of scratch. */
    double *reals; /* [11][rows][width] */
    /* The node that a course forces it to drain to, its receiver (-1: none), the order, three of scratch. */
    int32_t *integers; /* [6][rows][width] */
    /* Kind (0 outside, 1 inner, 2 outlet, 3 open end of a course) and number of donors. */
    int8_t *bytes; /* [2][rows][width] */
} DrainageRasters;

/* Copy a level into rasters: all that the other functions read, but for least heights and strata. Heights
 * start from the coarser level (NaN: none), moved by a hash, or from noise; or from the heights `onto` which
 * the coarser level's differences are added (NaN, or `base`: none). False if a course leads elsewhere than to
 * one of the eight neighbours. */
HOST bool pack_drainage(
    const DrainageRasters *rasters, int64_t start_rows, int64_t start_columns,
    const double uplift[restrict rasters->rows - 2][rasters->width - 2], /* m/m */
    const double repose[restrict rasters->rows - 2][rasters->width - 2], /* m/m */
    const double rain[restrict rasters->rows - 2][rasters->width - 2], /* m^2 */
    const double base[restrict rasters->rows - 2][rasters->width - 2], /* of outlets, m */
    const bool domain[restrict rasters->rows - 2][rasters->width - 2],
    const int32_t course[restrict (rasters->rows - 2) * (rasters->width - 2)], /* node, -1: free */
    const double onto[restrict rasters->rows - 2][rasters->width - 2], /* m */
    const double start[restrict start_rows][start_columns], /* of the coarser level, m */
    int64_t row, int64_t column, /* global indices of the first node */
    int64_t level, int64_t start_row, int64_t start_column); /* the same of the coarser level */

/* Route and integrate some times; every round but the last goes a part of the way. */
HOST void run_drainage(const DrainageRasters *rasters, int64_t rounds);

/* Find receivers and drainage areas; returns the number of nodes in the order of flow. */
HOST int64_t route_drainage(const DrainageRasters *rasters);

/* Sum drainage areas along given receivers; returns the number of nodes in the order of flow. */
HOST int64_t accumulate_drainage(const DrainageRasters *rasters);

/* Build heights up from the outlets, against the order of flow of a number of nodes. */
HOST void integrate_drainage(const DrainageRasters *rasters, int64_t count);

/* Lower nodes that stand above any neighbour by more than repose allows, and let them drain there; courses
 * sink to the lowest ground beside them. */
HOST void limit_slopes(const DrainageRasters *rasters);

/* Lower courses to the lowest ground beside them, so that it drains to them; none leads uphill. */
HOST void sink_courses(const DrainageRasters *rasters);

/* Lower nodes that stand above those which drain to them, down the flow, but not below a floor (m). */
HOST void carve_barriers(
    const DrainageRasters *rasters, int64_t count, const double lowest[rasters->rows][rasters->width]);

/* Move heights back towards those before the last routing: fewer channels change their course. */
HOST void relax_heights(const DrainageRasters *rasters);

/* Turn weights of nodes, 0 ... 1, into the shares that they have of drainage areas. */
HOST void drainage_shares(
    const DrainageRasters *rasters, int64_t count, double weight[restrict rasters->rows][rasters->width]);

/* Find heights from which the ground falls away from outlets at a share of repose. */
HOST void outlet_ramps(
    int64_t rows, int64_t columns,
    const double base[restrict rows][columns], /* of outlets, m, NaN elsewhere */
    const double repose[restrict rows][columns], /* m/m */
    const bool domain[restrict rows][columns],
    double spacing, /* m */
    double least[restrict rows][columns]); /* m */

/* Reduce a level by two, from the first node of an even global index on: means over 3 x 3 nodes of the
 * domain, four times the mean rain, the lowest outlet, and courses walked over coarse nodes, each of which
 * drains to what the last fine node in it leads to. False if a course runs in a circle. */
HOST bool coarsen_drainage(
    int64_t rows, int64_t columns, int64_t coarse_rows, int64_t coarse_columns,
    const double uplift[restrict rows][columns], /* m/m */
    const double repose[restrict rows][columns], /* m/m */
    const double rain[restrict rows][columns], /* m^2 */
    const double base[restrict rows][columns], /* m */
    const bool domain[restrict rows][columns], const int32_t course[restrict rows * columns],
    int64_t first_row, int64_t first_column, /* that is kept, 0 or 1 */
    double fields[restrict 4][coarse_rows][coarse_columns], /* uplift, repose, rain, base */
    bool domains[restrict coarse_rows][coarse_columns],
    int32_t courses[restrict coarse_rows * coarse_columns], int32_t scratch[restrict 3][rows * columns]);
