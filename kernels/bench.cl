// What noise alone costs: fBm on a square grid, nothing else read or written.
#include "noise.clh"

// Sums all octaves at each vertex of a side x side grid, row 0 northernmost.
//   octaves      octaves in the three arrays, see noise.clh
//   west, north  the first vertex, lattice units; step  distance between vertices, lattice units
//   sum          side * side
// Global size: (side, side).
__kernel void bench_fbm(__global const int4 *octave_form, __global const long2 *octave_offset,
                        __global const REAL2 *octave_scale, int octaves, long west, long north, long step,
                        int side, __global REAL *sum)
{
    const Octaves table = {octave_form, octave_offset, octave_scale};
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    if (column >= side) return;
    const long4 p = skewed(west + column * step, north - row * step);
    sum[row * side + column] = fbm(table, 0, octaves, p);
}
