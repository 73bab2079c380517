// What noise alone costs: fBm on a square grid, nothing else read or written; and detail below a DEM on a plane.
#define PATCH_POSITIONS
#include "layers/base_detail.clh"

// Sums all octaves at each vertex of one patch of side x side vertices, row 0 southernmost.
//   octave_*   see Octaves in positions.clh; octave_count octaves
//   sum        side * side
// Global size: (side, side).
__kernel void bench_fbm(__global const int4 *octave_form, __global const long2 *octave_offset,
                        __global const REAL2 *octave_scale, __global const uint4 *octave_corner, int octave_count,
                        int side, __global REAL *sum)
{
    const Octaves octaves = {octave_form, octave_offset, octave_scale, octave_corner, octave_count};
    const size_t column = get_global_id(0);
    const size_t row = get_global_id(1);
    sum[row * side + column] = fbm(octaves, 0, octave_count, lattice_point(0, 0, 0, (int)column, (int)row, 0));
}

// The same with the slope of the sum, per lattice unit.
__kernel void bench_fbm_slope(__global const int4 *octave_form, __global const long2 *octave_offset,
                              __global const REAL2 *octave_scale, __global const uint4 *octave_corner,
                              int octave_count, int side, __global REAL *sum, __global REAL *east,
                              __global REAL *north)
{
    const Octaves octaves = {octave_form, octave_offset, octave_scale, octave_corner, octave_count};
    const size_t column = get_global_id(0);
    const size_t row = get_global_id(1);
    const ValueSlope s = fbm_slope(octaves, 0, octave_count, lattice_point(0, 0, 0, (int)column, (int)row, 0));
    const size_t at = row * side + column;
    sum[at] = s.value;
    east[at] = s.east;
    north[at] = s.north;
}

// Detail of all octaves on a plane that falls by 0.5.
__kernel void bench_base_detail(__global const int4 *octave_form, __global const long2 *octave_offset,
                                __global const REAL2 *octave_scale, __global const uint4 *octave_corner,
                                int octave_count, int side, __global const World *world, BASE_DETAIL_ARGUMENTS,
                                __global REAL *sum)
{
    const Octaves octaves = {octave_form, octave_offset, octave_scale, octave_corner, octave_count};
    const size_t column = get_global_id(0);
    const size_t row = get_global_id(1);
    const ValueSlope plane = {R(0), R(0.4), R(0.3)};
    const DetailScale scale = {R(4096), R(1), R(100)};
    BASE_DETAIL_COLLECT
    const LatticePoint p = lattice_point(0, 0, 0, (int)column, (int)row, 0);
    sum[row * side + column] = base_detail_at(octaves, *world, base_detail, p, plane, scale);
}
