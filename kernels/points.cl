// Heights and masks at single points.
#include "surface.clh"

// block[i] is the block of ground that point i lies in.
// Global size: count rounded up.
__kernel void points(TERRAIN_ARGUMENTS, __global const long *x, __global const long *y,
                     __global const int *block, int count, __global REAL *height, __global REAL *masks)
{
    COLLECT_OCTAVES
    COLLECT_LAYERS
    const int item = get_global_id(0);
    const int i = min(item, count - 1);
    const LatticePoint p = lattice_point(x[i], y[i]);
    const REAL cover_noise = has_forest(layers.points, block[i]) ? cover_noise_at(octaves, *world, p) : R(0);
    const TerrainSample g = terrain_at(octaves, world, layers, block[i], p, true, cover_noise);
    if (item >= count) return;
    height[item] = g.height;
    __global REAL *mask = masks + MASKS * item;
    mask[MASK_MOUNTAIN] = g.mountain;
    mask[MASK_DUNE] = g.dune;
    mask[MASK_FOREST] = g.forest;
    mask[MASK_WATER] = g.water;
    mask[MASK_WETNESS] = g.wetness;
}
