/* Drained relief on rasters: the steady state of stream power with slopes below repose.
 *
 * z = z_receiver + S d with S = (s^-4 + repose^-4)^(-1/4), s = u / (A / r0^2)^(3/8); rounds of routing and
 * integrating after Tzathas et al., "Physically-based analytical erosion for fast terrain generation" (2024);
 * passes of depressions after Cordonnier et al., "A versatile, linear complexity algorithm for flow routing
 * in topographies with depressions" (2019): Boruvka's minimum spanning tree of basins.
 *
 * A level lies in rasters with a margin of one node outside of the domain, where heights are infinite; nodes
 * are row * width + column of these:
 *   reals: uplift (m/m), repose (m/m), rain (m^2), least height (m), strata (0 ... 1), height (m), area
 *     (m^2), height before the last routing (m), rise to the node (m), and two of scratch;
 *   integers: the node that a course forces it to drain to, its receiver (-1: none), the order of flow
 *     (donors before their receivers), and three of scratch;
 *   bytes: kind (0 outside, 1 inner, 2 outlet, 3 open end of a course) and number of donors.
 * `pack_drainage` writes all that the other functions read; least heights and strata may be set after it.
 */
#pragma once

#include "host.h"

#define LEAST_SLOPE 0.0001220703125 /* 2^-13, of a node to its receiver, where nothing is uplifted */
#define LEAST_RISE 1e-6 /* of a course, m */

/* Copy a level into rasters with a margin. Heights start from the coarser level (NaN: none), moved by a hash,
 * or from noise; or from the heights `onto` which the coarser level's differences are added (NaN, or `base`:
 * none). False if a course leads elsewhere than to one of the eight neighbours. */
HOST bool pack_drainage(
    int64_t rows, int64_t columns, int64_t start_rows, int64_t start_columns,
    const double uplift[restrict rows][columns], /* m/m */
    const double repose[restrict rows][columns], /* m/m */
    const double rain[restrict rows][columns], /* m^2 */
    const double base[restrict rows][columns], /* of outlets, m */
    const bool domain[restrict rows][columns],
    const int32_t course[restrict rows * columns], /* node of the raster without margin, -1: free */
    const double onto[restrict rows][columns], /* m */
    const double start[restrict start_rows][start_columns], /* of the coarser level, m */
    int64_t row, int64_t column, /* global indices of the first node */
    int64_t level,
    int64_t start_row, int64_t start_column, /* the same of the coarser level */
    double spacing, /* m */
    double reals[restrict 11][rows + 2][columns + 2], int32_t integers[restrict 6][rows + 2][columns + 2],
    int8_t bytes[restrict 2][rows + 2][columns + 2]);

/* Route and integrate some times; every round but the last goes a part of the way. */
HOST void run_drainage(
    int64_t rows, int64_t width, int64_t rounds,
    double spacing, /* m */
    double per_area, /* 1 / r0^2 of the spacing r0 of level 0, 1/m^2 */
    double reals[restrict 11][rows][width], int32_t integers[restrict 6][rows][width],
    int8_t bytes[restrict 2][rows][width]);

/* Find receivers and drainage areas; returns the number of nodes in the order of flow. */
HOST int64_t route_drainage(
    int64_t rows, int64_t width, double reals[restrict 11][rows][width],
    int32_t integers[restrict 6][rows][width], int8_t bytes[restrict 2][rows][width]);

/* Sum drainage areas along given receivers; returns the number of nodes in the order of flow. */
HOST int64_t accumulate_drainage(
    int64_t rows, int64_t width, double reals[restrict 11][rows][width],
    int32_t integers[restrict 6][rows][width], int8_t bytes[restrict 2][rows][width]);

/* Build heights up from the outlets, against the order of flow. */
HOST void integrate_drainage(
    int64_t rows, int64_t width,
    int64_t count, /* of nodes in the order of flow */
    double spacing, /* m */
    double per_area, /* 1/m^2 */
    double reals[restrict 11][rows][width], int32_t integers[restrict 6][rows][width],
    int8_t bytes[restrict 2][rows][width]);

/* Lower nodes that stand above any neighbour by more than repose allows, and let them drain there; courses
 * sink to the lowest ground beside them. */
HOST void limit_slopes(
    int64_t rows, int64_t width,
    double spacing, /* m */
    double reals[restrict 11][rows][width], int32_t integers[restrict 6][rows][width],
    int8_t bytes[restrict 2][rows][width]);

/* Lower courses to the lowest ground beside them, so that it drains to them; none leads uphill. */
HOST void sink_courses(
    int64_t rows, int64_t width, double reals[restrict 11][rows][width],
    int32_t integers[restrict 6][rows][width], int8_t bytes[restrict 2][rows][width]);

/* Lower nodes that stand above those which drain to them, down the flow, but not below a floor. */
HOST void carve_barriers(
    int64_t rows, int64_t width,
    int64_t count, /* of nodes in the order of flow */
    double spacing, /* m */
    const double lowest[restrict rows][width], /* the floor, m */
    double reals[restrict 11][rows][width], int32_t integers[restrict 6][rows][width],
    int8_t bytes[restrict 2][rows][width]);

/* Move heights back towards those before the last routing: fewer channels change their course. */
HOST void relax_heights(
    int64_t rows, int64_t width, double reals[restrict 11][rows][width],
    int8_t bytes[restrict 2][rows][width]);

/* Turn weights of nodes, 0 ... 1, into the shares that they have of drainage areas. */
HOST void drainage_shares(
    int64_t rows, int64_t width,
    int64_t count, /* of nodes in the order of flow */
    double weight[restrict rows][width], const double reals[restrict 11][rows][width],
    const int32_t integers[restrict 6][rows][width]);

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
