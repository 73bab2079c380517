// Heights, masks, normals and material weights of patches, and heights at single points.
#include "terrain.clh"
#include "materials.clh"

// In kernels with loops over features, work items beyond the last vertex repeat it and store nothing: a return at
// the start would keep CPU drivers from running those loops in vectors.

// Same arguments in the same order for both kernels that evaluate terrain: see world.clh for their meaning.
#define TERRAIN_ARGUMENTS                                                                                     \
    __global const World *world, __global const DuneStyle *styles, __global const int4 *octave_form,          \
        __global const long2 *octave_offset, __global const REAL2 *octave_scale,                              \
        __global const long2 *feature_at, __global const REAL4 *feature_shape,                                \
        __global const int *feature_starts, __global const int *feature_list,                                 \
        __global const long2 *lake_at, __global const int4 *lake_form, __global const REAL4 *lake_shape,      \
        __global const REAL4 *lake_profile, __global const REAL *lake_samples,                                \
        __global const int *lake_starts, __global const int *lake_list,                                       \
        __global const long2 *river_from, __global const REAL4 *river_along, __global const REAL4 *river_up,  \
        __global const REAL4 *river_down, __global const int *river_starts, __global const int *river_list

#define COLLECT_ARGUMENTS                                                                                     \
    const Octaves octaves = {octave_form, octave_offset, octave_scale};                                       \
    const Features features = {feature_at, feature_shape, feature_starts, feature_list};                      \
    const Lakes lakes = {{lake_at, lake_form, lake_shape, lake_samples, lake_starts, lake_list}, lake_profile}; \
    const Rivers rivers = {river_from, river_along, river_up, river_down, river_starts, river_list};

// Heights and masks of patches, each of side x side vertices, row 0 northernmost.
//   axis_x, axis_y  patches * side lattice coordinates; axis_y runs north to south
//   height          patches * side * side, m
//   masks           the same, REAL4: mountain, dune, forest, water
// Global size: (side^2 rounded up, patches).
__kernel void patches(TERRAIN_ARGUMENTS, __global const long *axis_x, __global const long *axis_y, int side,
                      __global REAL *height, __global REAL4 *masks)
{
    COLLECT_ARGUMENTS
    const int count = side * side;
    const int item = get_global_id(0);
    const int vertex = min(item, count - 1);
    const int patch = get_global_id(1);
    const int row = vertex / side;
    const int column = vertex - row * side;
    const Ground g = terrain_at(octaves, features, lakes, rivers, styles, world, patch, axis_x[patch * side + column],
                                axis_y[patch * side + row]);
    if (item >= count) return;
    const size_t at = (size_t)patch * count + item;
    height[at] = g.height;
    masks[at] = (REAL4)(g.mountain, g.dune, g.forest, g.water);
}

// Heights and masks at single points. block[i] is the block of ground that point i lies in.
// Global size: count rounded up.
__kernel void points(TERRAIN_ARGUMENTS, __global const long *x, __global const long *y,
                     __global const int *block, int count, __global REAL *height, __global REAL4 *masks)
{
    COLLECT_ARGUMENTS
    const int item = get_global_id(0);
    const int i = min(item, count - 1);
    const Ground g = terrain_at(octaves, features, lakes, rivers, styles, world, block[i], x[i], y[i]);
    if (item >= count) return;
    height[item] = g.height;
    masks[item] = (REAL4)(g.mountain, g.dune, g.forest, g.water);
}

// Normals and material weights of patches whose heights have a border of one vertex on each side.
//   axis_x, axis_y    patches * side lattice coordinates, as for `patches`
//   inverse_x, _y     patches * side: 1 / distance between the two neighbours of a vertex, 1/m; 0 at the rim
//   height, masks     patches * side^2
//   normal            patches * (side-2)^2 * 3: unit vectors, x east, y north, z up
//   material          patches * (side-2)^2 * MATERIALS: weights that sum to 1
// Normals are central differences: (-dz/dx, -dz/dy, 1) / |...|. Global size: ((side-2)^2 rounded up, patches).
__kernel void surfaces(__global const World *world, __global const Climate *climate,
                       __global const int4 *octave_form, __global const long2 *octave_offset,
                       __global const REAL2 *octave_scale, __global const long *axis_x,
                       __global const long *axis_y, __global const REAL *inverse_x,
                       __global const REAL *inverse_y, int side, __global const REAL *height,
                       __global const REAL4 *masks, __global const long2 *cover_at,
                       __global const int4 *cover_form, __global const REAL4 *cover_shape,
                       __global const REAL *cover_samples, __global const int *cover_starts,
                       __global const int *cover_list, __global REAL *normal, __global REAL *material)
{
    const Octaves octaves = {octave_form, octave_offset, octave_scale};
    const Fields covers = {cover_at, cover_form, cover_shape, cover_samples, cover_starts, cover_list};
    const int inner = side - 2;
    const int vertex = get_global_id(0);
    const int patch = get_global_id(1);
    if (vertex >= inner * inner) return;
    const int row = vertex / inner + 1;
    const int column = vertex - (row - 1) * inner + 1;
    __global const REAL *z = height + (size_t)patch * side * side + row * side + column;

    const REAL slope_x = (z[1] - z[-1]) * inverse_x[patch * side + column];
    const REAL slope_y = (z[-side] - z[side]) * inverse_y[patch * side + row];
    const REAL steepness2 = slope_x * slope_x + slope_y * slope_y;
    const REAL nz = inverse_sqrt(R(1) + steepness2);
    const long x = axis_x[patch * side + column];
    const long y = axis_y[patch * side + row];
    const REAL mottle = MOTTLE_CONTRAST * fbm(octaves, world->mottle_first, world->mottle_last, skewed(x, y));
    // Laplacian times the spacing: how much lower or higher than its neighbours, as a slope.
    const REAL hollow = R(0.5) * ((z[1] + z[-1] - z[0] - z[0]) * inverse_x[patch * side + column]
                                  + (z[side] + z[-side] - z[0] - z[0]) * inverse_y[patch * side + row]);
    const REAL4 mask = masks[(size_t)patch * side * side + row * side + column];
    const size_t at = (size_t)patch * inner * inner + vertex;
    normal[3 * at] = -slope_x * nz;
    normal[3 * at + 1] = -slope_y * nz;
    normal[3 * at + 2] = nz;

    REAL weights[MATERIALS] = {R(1), R(0), R(0), R(0), R(0), R(0), R(0), R(0)};
    lay_materials(*climate, z[0], square_root(steepness2), hollow, mask, mottle, weights);
    lay_covers(covers, cover_starts[patch], cover_starts[patch + 1], x, y, mottle, weights);
    for (int k = 0; k < MATERIALS; ++k) material[MATERIALS * at + k] = weights[k];
}
