/* Wetness of drained ground: a topographic wetness index that spreads over level ground.
 *
 * log2(a / S) with the drainage area a per width of a node, over the spacing of level 0, and the slope S to
 * the lowest neighbour (Beven & Kirkby, "A physically based, variable contributing area model of basin
 * hydrology", 1979). From node to node it falls by no more than a part of the way and of the rise (compare
 * Bohner & Selige, "Spatial prediction of soil attributes using terrain analysis and climate
 * regionalisation", 2006). The logarithm is linear between powers of two: its bits depend on no library.
 */
#pragma once

#include "host.h"

/* Find the wetness, 0 ... 1, of nodes; 0 of those without height (NaN). */
HOST void wetness(
    int64_t rows, int64_t columns,
    const double height[restrict rows][columns], /* m */
    const double area[restrict rows][columns], /* m^2; a node's own counts as one of level 0 */
    double spacing, /* m */
    double finest, /* spacing of level 0, m */
    float wet[restrict rows][columns], double scratch[restrict 2][rows + 2][columns + 2]);
