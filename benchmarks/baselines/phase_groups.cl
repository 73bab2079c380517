// Poisson-disk points in the way of Zaaijer 2013, chapter 6, after Wei 2008 ("Parallel Poisson disk sampling"): cells
// far enough apart for their points not to conflict, a phase group, throw darts at once; from coarse cells to fine.
// It is written as one writes it for a GPU, branches included.

#define EMPTY (-1)
#define TEA_DELTA 0x9E3779B9u
#define TEA_ROUNDS 3   // "only three iterations" are enough (section 6.3)
#define SPREAD_CELL 0x9E3779B1u   // any odd numbers: three iterations alone leave neighbours too much alike,
#define SPREAD_TRIAL 0x85EBCA77u  // so that darts of one cell fall together and a tenth of the points is lost

// The Tiny Encryption Algorithm as a hash (Zafar, Olano & Curtis 2010, "GPU random numbers via the Tiny Encryption
// Algorithm"), the cipher of section 6.3; any key will do.
inline uint2 tea(uint2 v)
{
    uint sum = 0;
    for (int i = 0; i < TEA_ROUNDS; ++i) {
        sum += TEA_DELTA;
        v.s0 += ((v.s1 << 4) + 0xA341316Cu) ^ (v.s1 + sum) ^ ((v.s1 >> 5) + 0xC8013EA4u);
        v.s1 += ((v.s0 << 4) + 0xAD90777Du) ^ (v.s0 + sum) ^ ((v.s0 >> 5) + 0x7E95761Eu);
    }
    return v;
}

// Darts at every `apart`-th cell from (first_column, first_row) on, where it is empty.
//   index        int a cell: its point's number, or EMPTY
//   points       float2, written one after another; count  how many there are, an atomic counter
//   columns      cells along the area's side, at most; cell  their width; side  of the area; distance  r
//   reach        how many cells away a point can be nearer than r
//   first_trial, trials  which darts are thrown; seed
// Global size: (columns / apart, columns / apart), both rounded up and more.
__kernel void throw_darts(__global int *index, __global float2 *points, __global int *count, int columns, float cell,
                          float side, float distance, int reach, int apart, int first_column, int first_row,
                          int first_trial, int trials, uint seed)
{
    const int i = get_global_id(0) * apart + first_column;
    const int j = get_global_id(1) * apart + first_row;
    if (i >= columns || j >= columns) return;
    if (index[j * columns + i] != EMPTY) return;
    for (int trial = first_trial; trial < first_trial + trials; ++trial) {
        const uint2 bits = tea((uint2)((uint)(j * columns + i) * SPREAD_CELL, (seed + (uint)trial) * SPREAD_TRIAL));
        const float2 dart = ((float2)(i, j) + convert_float2(bits >> 8) * 0x1p-24f) * cell;
        if (dart.s0 >= side || dart.s1 >= side) continue;
        bool free = true;
        for (int row = max(j - reach, 0); free && row <= min(j + reach, columns - 1); ++row) {
            for (int column = max(i - reach, 0); free && column <= min(i + reach, columns - 1); ++column) {
                const int other = index[row * columns + column];
                if (other == EMPTY) continue;
                const float2 away = points[other] - dart;
                free = dot(away, away) >= distance * distance;
            }
        }
        if (!free) continue;
        const int number = atomic_inc(count);
        points[number] = dart;
        index[j * columns + i] = number;
        return;
    }
}

// Puts each point of a level into the cell of the next one, cells half as wide, that it lies in.
// Global size: (columns, columns) of the coarse level.
__kernel void refine(__global const int *coarse, __global int *fine, __global const float2 *points, int columns,
                     float fine_cell)
{
    const int i = get_global_id(0);
    const int j = get_global_id(1);
    if (i >= columns || j >= columns) return;
    const int number = coarse[j * columns + i];
    int column = EMPTY, row = EMPTY;
    if (number != EMPTY) {
        // A dart on the border may round to either side: it stays in its cell.
        column = clamp((int)(points[number].s0 / fine_cell), 2 * i, 2 * i + 1);
        row = clamp((int)(points[number].s1 / fine_cell), 2 * j, 2 * j + 1);
    }
    for (int y = 2 * j; y < 2 * j + 2; ++y) {
        for (int x = 2 * i; x < 2 * i + 2; ++x) {
            fine[y * 2 * columns + x] = x == column && y == row ? number : EMPTY;
        }
    }
}
