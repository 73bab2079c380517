/* Relief of unpainted ground (m above its valleys): gentle swells, ranges of mountains and hills by density,
 * and ranges beyond the sketch, which raise valleys too. Points are mesh units; nodes of a level stand
 * SIDE · 2^level of them apart. Uplift is proportional to relief.
 */
#pragma once

#include "mesh.h"

#define RANGE_VALLEYS 0.45 /* what ranges beyond the sketch raise valleys by, over their height */

/* Lengths in mesh units. */
typedef struct {
    uint64_t key;
    double roughness;
    double ground; /* relief, m */
    double ground_scale; /* 1 / wavelength */
    double pediments; /* 0 … 1: how much of the ground is nearly level */
    double mountain; /* height, m; 0: none */
    double mountain_scale;
    double mountain_threshold;
    double hill;
    double hill_scale;
    double hill_threshold;
    double per_relief; /* uplift over relief, 1/m */
    double range; /* height of ranges beyond the sketch, m */
    double range_threshold;
    double range_rock; /* 0 … 1 */
} UpliftFields;

/* Relief, the mountains' share, and the height of ranges beyond the sketch, at points. */
HOST void relief_at_points(
    const UpliftFields *fields, int64_t points, const int64_t point[restrict points][2], /* x and y */
    double relief[restrict points], /* m */
    double share[restrict points], /* 0 … 1 */
    double beyond[restrict points]); /* m */

/* Bilinear interpolation of nodes 2^bits nodes apart, whose first one is at or before node (column, row). */
HOST void interpolated_nodes(
    int64_t bits, int64_t column, int64_t row, int64_t coarse_rows, int64_t coarse_columns,
    const double coarse[restrict coarse_rows][coarse_columns], int64_t rows, int64_t columns,
    double fine[restrict rows][columns]);

/* Uplift at nodes of a level, varied over 8 and 16 nodes of level 0. */
HOST void roughened_uplift(
    const UpliftFields *fields, int64_t level, int64_t column, int64_t row, int64_t rows, int64_t columns,
    const double relief[restrict rows][columns], /* m */
    double uplift[restrict rows][columns], double scratch[restrict columns]);

/* Heights of the smooth mean of the ground, and the mountains' share, at nodes of a level. */
HOST void mean_ground(
    const MeshParameters *mesh, const UpliftFields *fields, int64_t level, int64_t column, int64_t row,
    int64_t rows, int64_t columns,
    double height[restrict rows][columns], /* m */
    double share[restrict rows][columns]); /* 0 … 1 */
