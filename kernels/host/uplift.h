/* Painted features that raise ground, at nodes of a raster: where they lie, and control of their heights.
 *
 * Positions and radii are in nodes of level 0, x along columns. Means weigh features by t³ r², which falls
 * from the radius r at a feature to 0 at its reach, t = 1 - distance / reach.
 */
#pragma once

#include "host.h"

/* Add an octave of value noise to nodes of level 0, from node (column, row) on. */
HOST void uneven_noise(
    int64_t row, int64_t column, uint64_t key,
    int64_t bits, /* of the noise's cells, mesh units */
    double amplitude, int64_t rows, int64_t columns, double noise[restrict rows][columns]);

/* Raise values to the greatest depth inside any feature over its radius: negative outside, up to `zone`. */
HOST void feature_nearness(
    int64_t features, const double x[restrict features], const double y[restrict features],
    const double radius[restrict features], double zone, int64_t rows, int64_t columns,
    double near[restrict rows][columns]);

/* Where nodes lie in features: depth inside the outline of any feature over its radius, negative outside; the
 * deepest feature, -1 outside of all cores; and weighted means of the features' values. */
HOST void features_at(
    int64_t features, int64_t values, const double x[restrict features], const double y[restrict features],
    const double radius[restrict features], const double value[restrict features][values],
    const int64_t belongs[restrict features], /* number of a feature's shape */
    int64_t rows, int64_t columns,
    const int32_t region[restrict rows][columns], /* number of the shape at a node, -1 none */
    double outside, /* depth away from all features */
    double depth[restrict rows][columns], int64_t owner[restrict rows][columns],
    double means[restrict rows][columns][values], /* given as zeros */
    double scratch[restrict 4][rows][columns]); /* … too */

/* Weighted mean of the factors of features near nodes, 1 away from them. Nodes are `step` nodes of level 0
 * apart, from node (row, column) of these on. */
HOST void mean_factors(
    int64_t features, const double x[restrict features], const double y[restrict features],
    const double radius[restrict features], const double factor[restrict features],
    const int64_t belongs[restrict features], int64_t fine_rows, int64_t fine_columns,
    const int32_t region[restrict fine_rows][fine_columns],
    int64_t row, int64_t column, int64_t step, int64_t rows, int64_t columns,
    double mean[restrict rows][columns], /* given as zeros */
    double scratch[restrict rows][columns]); /* … too */

/* Scale the factors of groups of features by a share of how far their highest crests, as splines read them,
 * are from their aims. */
HOST void adjust_factors(
    int64_t rows, int64_t columns,
    const double effect[restrict rows][columns], /* what the features raise nodes by, m */
    const double below[restrict rows][columns], /* height of the ground below, m */
    int64_t fine_rows, int64_t fine_columns,
    const double target[restrict fine_rows][fine_columns], /* height of a crest there, m */
    const int64_t owner[restrict fine_rows][fine_columns], /* the feature at a node, -1 none */
    int64_t features, int64_t groups, const int64_t group[restrict features],
    double least_rise, /* that counts, m */
    int64_t row, int64_t column, int64_t step, double share, double factor[restrict features],
    double scratch[restrict groups]);
