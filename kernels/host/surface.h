/* The surface of a set of DEM patches, and the distance of patches from the samples they were fitted to.
 *
 * f = sum w_p f_p / sum w_p: Rocca, Panozzo & Puppo, "Patchwork terrains" (2012), equation 1. Patches are
 * bicubic B-splines of 35 x 35 coefficients over 32 x 32 steps of their level, columns along u, rows along v.
 */
#pragma once

#include "host.h"

/* Evaluate points begin ... end - 1. */
HOST void evaluate_surface(
    int64_t points, int64_t patches, int64_t masked, int64_t classes, int64_t cells, int64_t listed,
    int64_t grids, int64_t quantities,
    const double x[restrict points], const double y[restrict points], /* m */
    const double centre[restrict patches][2], /* m */
    const double to_steps[restrict patches][2][6], /* u and v of 1, x, y, x^2, xy, y^2, m from the centre */
    const double density[restrict patches], /* 1 / area of a step, squared, 1/m^4 */
    const double base[restrict patches], /* m */
    const int32_t grid[restrict patches],
    const float coefficients[restrict patches][35][35], /* m above the base */
    const int64_t mask_of[restrict patches], /* -1 where data are all around */
    const uint8_t masks[restrict masked][35][35], /* coefficients of the weight of data, 1/225 */
    const double rims[restrict masked][5], /* sides west, east, north, south of the grid, steps; 2^level */
    const double places[restrict classes][3], /* of an index of boxes: west, south, side of cells, m */
    const int64_t shapes[restrict classes][3], /* cells eastward, northward, and the first one's number */
    const int64_t starts[restrict cells], /* the last one is the end */
    const int64_t items[restrict listed], /* patches, ascending in each cell */
    const double values[restrict grids][quantities],
    double height[restrict points], /* m; NaN without data, as the slopes */
    double east[restrict points], double north[restrict points], /* slopes, m/m */
    double data[restrict points], /* weight of the data, 0 ... 1 */
    double count[restrict points], /* patches that have a weight */
    double means[restrict quantities][points], /* of values by the weights of patches; 0 without data */
    int64_t begin, int64_t end);

/* Raise the errors of patches to their largest distance from a strip of samples: |B-spline - sample|. */
HOST void measure_patches(
    int64_t deep, int64_t wide, int64_t rows, int64_t columns, int64_t scale, int64_t down, int64_t across,
    const float spline[restrict deep][wide], /* coefficients of a level, m above the base */
    int64_t low, /* row of the first coefficients */
    const float samples[restrict rows][columns], /* m; NaN in voids */
    int64_t start, /* row of the first samples */
    double base, /* m */
    const double w0[restrict scale], const double w1[restrict scale], /* weights of four coefficients ... */
    const double w2[restrict scale], const double w3[restrict scale], /* ... at samples along a step */
    int64_t first, int64_t last, /* rows of patches: first ... last - 1 */
    double error[restrict down][across]); /* m */
