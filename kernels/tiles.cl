// Patches of terrain: heights and masks, then normals and material weights, their parents', and the vertices of tiles.
// Vertices of tiles, and of rasters that are made of them, lie whole powers of two of lattice units apart; terrain.cl
// builds the same kernels with AXIS_POSITIONS, for vertices that lie anywhere.
#ifndef AXIS_POSITIONS
#define PATCH_POSITIONS
#endif
#include "surface.clh"
#include "vertices.clh"

// Heights and masks of patches, each of side x side vertices, row 0 northernmost.
//   squares      along a side of a patch; each has lists of its own, so that a wide patch need not evaluate all its
//                features everywhere; counted from the west, and then from the north
//   square_side  vertices along a square's side; the last ones may have fewer
//   bare         1 for heights alone, without buffers for masks and cover_noise
// Global size: (square_side^2 rounded up, patches * squares^2).
__kernel void patches(TERRAIN_ARGUMENTS,
#ifdef PATCH_POSITIONS
                      NOISE_ARGUMENTS,
#endif
                      VERTEX_ARGUMENTS, int side, int squares, int square_side, int bare, RESULT_ARGUMENTS)
{
    COLLECT_OCTAVES
    COLLECT_LAYERS
    const int count = square_side * square_side;
    const int item = get_global_id(0);
    const int inside = min(item, count - 1);
    const int block = get_global_id(1);
    const int patch = block / (squares * squares);
    const int square = block - patch * squares * squares;
    const int first_row = square / squares * square_side;
    const int first_column = square % squares * square_side;
    const int row_inside = row_of(inside, square_side);
    const int row = min(first_row + row_inside, side - 1);
    const int column = min(first_column + inside - row_inside * square_side, side - 1);
    const LatticePoint p = VERTEX(patch, column, row);
    const REAL cover = bare ? R(0) : cover_noise_at(octaves, *world, p);
    const TerrainSample g = terrain_at(octaves, world, layers, block, p, !bare, cover);
    if (item >= count) return;
    const size_t plane = (size_t)side * side;
    // Two calls, since CPU drivers write consecutive vertices at once.
    if (squares == 1)
        write_vertex(height, masks, cover_noise, built, plane, patch, patch * plane + item, g, cover, bare);
    else
        write_vertex(height, masks, cover_noise, built, plane, patch, patch * plane + row * side + column, g, cover, bare);
}

// Normals, heights without their border and material weights of patches, written where the patches live.
//   slot                   patches: which place each has in what is written
//   ground                 slots * (side-2)^2 * 4: unit normal, height (m)
//   material               slots * (side-2)^2 * MATERIALS: weights that sum to 1
// Global size: (side-2, side-2, patches), groups of whole rows: CPU drivers take a row's vertices side by side.
__kernel void surfaces(SURFACE_ARGUMENTS, __global const int *slot, __global REAL *ground, __global REAL *material)
{
    const int inner = side - 2;
    const int patch = get_global_id(2);
    const int row = get_global_id(1);
    const int column = get_global_id(0);
    const Surface surface = surface_at(SURFACE_NAMES, patch, row + 1, column + 1);
    const size_t start = (size_t)slot[patch] * inner * inner;
    const int at = row * inner + column;
    vstore4(surface.ground, at, ground + 4 * start);
    __global REAL *own = material + MATERIALS * (start + at);
    for (int m = 0; m < MATERIALS; ++m) own[m] = surface.weights[m];
}

// The parent's values at the vertices of each tile. Between two of its vertices they are half their sum, along
// an edge or along the diagonal from north-west to south-east by which quads are cut into triangles.
//   inverse   1 / distance between the two neighbours of a parent's vertex, 1/m
//   side      of the parent's patch: half the tile's quads, its vertices and a border of one
//   height    patches * side^2, m, at the parent's cell size
//   slot      as in `surfaces`
//   parent    slots * inner^2 * 4 as `ground`; inner = 2 side - 5
// Each work item takes a parent's vertex and the children half a quad east and south of it. It reads up to two rows
// beyond the patch for values that it does not store: the buffer has two spare rows for them.
// Global size: (side-2, side-2, patches), groups of whole rows.
__kernel void parents(REAL inverse, int side, __global const REAL *height, __global const int *slot,
                      __global REAL *parent)
{
    const int quads = side - 3;
    const int inner = 2 * quads + 1;
    const int patch = get_global_id(2);
    const int row = get_global_id(1);
    const int column = get_global_id(0);
    __global const REAL *z = height + (size_t)patch * side * side + ((row + 1) * side + column + 1);
    const REAL2 slope = slope_at(z, side, inverse, inverse);
    const REAL2 east = (slope + slope_at(z + 1, side, inverse, inverse)) * R(0.5);
    const REAL2 south = (slope + slope_at(z + side, side, inverse, inverse)) * R(0.5);
    const REAL2 diagonal = (slope + slope_at(z + side + 1, side, inverse, inverse)) * R(0.5);
    __global REAL *own = parent + (size_t)slot[patch] * 4 * inner * inner;
    const int at = 2 * (row * inner + column);
    vstore4(ground_of(slope, z[0]), at, own);
    if (column < quads) vstore4(ground_of(east, R(0.5) * (z[0] + z[1])), at + 1, own);
    if (row < quads) vstore4(ground_of(south, R(0.5) * (z[0] + z[side])), at + inner, own);
    if (column < quads && row < quads)
        vstore4(ground_of(diagonal, R(0.5) * (z[0] + z[side + 1])), at + inner + 1, own);
}

// Vertices of tiles. Each holds its own surface and the parent's, read from the same buffer: where the parent lacks a
// vertex, half the sum along its edge or its diagonal from north-west to south-east.
//   tile_slots  int4 a tile: slot, parent's slot (-1: it is its own parent), 1 if it is the parent's east half, 1 if the north
//   vertex  slots * (side-2)^2 * VERTEX_WORDS
// Global size: (side-2, side-2, tiles), groups of whole rows.
__kernel void vertices(SURFACE_ARGUMENTS, __global const int4 *tile_slots, __global uint *vertex)
{
    const int inner = side - 2;
    const int quads = inner - 1;
    const int patch = get_global_id(2);
    const int row = get_global_id(1);
    const int column = get_global_id(0);
    const Surface surface = surface_at(SURFACE_NAMES, patch, row + 1, column + 1);
    const int4 slots = tile_slots[patch];
    const uint z = as_uint((float)surface.ground.s3);
    const uint slope = packed_slope(surface.ground);
    uint words[WEIGHT_WORDS];
    for (int k = 0; k < WEIGHT_WORDS; ++k) words[k] = packed_weights(surface.weights, k);
    __global uint *own = vertex + ((size_t)slots.s0 * inner * inner + row * inner + column) * VERTEX_WORDS;
    uint4 packed = {z, z, slope, slope};
    for (int k = 0; k < WEIGHT_WORDS; ++k) own[4 + k] = words[k];
    if (slots.s1 >= 0) {
        __global const uint *parent = vertex + (size_t)slots.s1 * inner * inner * VERTEX_WORDS;
        const int east = column + slots.s2 * quads;
        const int south = row + (1 - slots.s3) * quads;
        __global const uint *a = parent + ((south >> 1) * inner + (east >> 1)) * VERTEX_WORDS;
        __global const uint *b = a + ((south & 1) * inner + (east & 1)) * VERTEX_WORDS;
        packed.s1 = as_uint(0.5f * (as_float(a[0]) + as_float(b[0])));
        packed.s3 = middle_slope(a[2], b[2]);
        for (int k = 0; k < WEIGHT_WORDS; ++k) words[k] = middle_weights(a[4 + k], b[4 + k]);
    }
    vstore4(packed, 0, own);
    for (int k = 0; k < WEIGHT_WORDS; ++k) own[4 + WEIGHT_WORDS + k] = words[k];
}

// Statistics of tiles, for each strip of columns of quads: the lowest and the highest height, own and parent's; the
// distance of full detail from the triangles, in the middles of the quads of its first column; non-finite heights.
//   stride   quads from sample to sample, and columns of a strip
//   sampled  0 where there are no samples
//   sample   tiles * (quads / stride)^2: heights at full detail, m, rows from north to south
//   slot     tiles
//   first    index of the first tile in the results
//   found    float4: tiles * quads / stride: lowest, highest, not 0 if a height is NaN or Inf, unused
//   away     tiles * (quads / stride)^2: distance, m, strips one after the other
// Global size: (quads / stride, tiles).
__kernel void facts(int quads, int stride, int sampled, __global const REAL *sample, __global const int *slot,
                    __global const uint *vertex, int first, __global float4 *found, __global float *away)
{
    const int strip = get_global_id(0);
    const int tile = get_global_id(1);
    const int strips = quads / stride;
    const int inner = quads + 1;
    __global const float *here = (__global const float *)vertex
                                 + ((size_t)slot[tile] * inner * inner + stride * strip) * VERTEX_WORDS;
    // The last strip takes the last column of vertices as well; for the others it is the next one's first.
    float lowest = here[0];
    float highest = lowest;
    float check = 0.0f;
    for (int row = 0; row < inner; ++row) {
        for (int column = 0; column <= stride; ++column) {
            __global const float *height = here + (row * inner + column) * VERTEX_WORDS;
            const float own = height[0];
            const float parent = height[1];
            const float least = own < parent ? own : parent;
            const float most = own < parent ? parent : own;
            lowest = least < lowest ? least : lowest;
            highest = most > highest ? most : highest;
            check += own * 0.0f + parent * 0.0f;
        }
    }
    for (int row = 0; row < strips; ++row) {
        const int at = (tile * strips + row) * strips + strip;
        __global const float *height = here + stride * row * inner * VERTEX_WORDS;
        const float middle = 0.5f * (height[0] + height[(inner + 1) * VERTEX_WORDS]);
        const float above = sampled ? (float)sample[at] - middle : 0.0f;
        const float apart = above < 0.0f ? -above : above;
        check += apart * 0.0f;
        away[((first + tile) * strips + strip) * strips + row] = apart;
    }
    found[(first + tile) * strips + strip] = (float4)(lowest, highest, check, 0.0f);
}
