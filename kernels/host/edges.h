/* Edges of areas: what they add to a raster of texels, and which are near blocks of lattice points. */
#pragma once

#include "host.h"

/* The greatest integer up to x within bounds, the lower one for NaN: of what is beyond, casts differ. */
static inline int64_t bounded_floor(double x, int64_t low, int64_t high)
{
    return (int64_t)least(greatest((double)low, floor(x)), (double)high);
}

/* Add to texels, rows from the south, what is east of edges that run south, less what is east of others:
 * share of a texel = integral over its part of the edge's rows of clamp(its eastern side - x, 0, 1).
 * Sums are of whole numbers, the same in any order. */
HOST void sum_edges(
    int64_t edges, int64_t rows, int64_t columns,
    const double edge[restrict edges][4], /* start and vector, texels */
    const double value[restrict edges][4], /* of the edge's area in a texel inside of it */
    int64_t total[restrict rows][columns][4],
    int64_t ahead[restrict rows][columns + 1][4]); /* scratch: added to a texel and all those east of it */

/* Find the edges near blocks, and whether the south-east corner of each is inside of the block's area: a ray
 * to the east crosses an odd number of edges. Returns how many are near; see docs/kernels/landuse.md. */
HOST int64_t edges_near(
    int64_t blocks, int64_t edges,
    const int64_t first[restrict blocks + 1], /* of the edges of each block's area */
    const double edge[restrict edges][4], /* start and end, m */
    const int64_t block[restrict blocks][4], /* west, south, east, north: lattice units */
    int64_t reach, /* of what is near, lattice units */
    double unit, /* m */
    int64_t farthest, /* from a block to the ends of its edges, lattice units */
    bool inside[restrict blocks],
    int64_t count[restrict blocks], /* of near edges */
    int32_t ends[restrict edges][4], /* from the block's corner, lower end first, lattice units */
    int32_t row[restrict edges][4]); /* LandUse.rows of kernels/layers/landuse.clh */
