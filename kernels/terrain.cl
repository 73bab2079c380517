// Terrain where vertices may lie anywhere: patches of any spacing, and single points.
#include "patches.clh"

// Heights and masks at single points. block[i] is the block of ground that point i lies in.
// Global size: count rounded up.
__kernel void points(TERRAIN_ARGUMENTS, __global const long *x, __global const long *y,
                     __global const int *block, int count, __global REAL *height, __global REAL4 *masks)
{
    COLLECT_OCTAVES
    COLLECT_FEATURES
    const int item = get_global_id(0);
    const int i = min(item, count - 1);
    const Place p = place_of(x[i], y[i]);
    const REAL mottle = has_forest(features, *world, block[i]) ? mottle_at(octaves, *world, p) : R(0);
    const Ground g = terrain_at(octaves, features, lakes, rivers, styles, world, block[i], p, true, mottle);
    if (item >= count) return;
    height[item] = g.height;
    masks[item] = (REAL4)(g.mountain, g.dune, g.forest, g.water);
}
