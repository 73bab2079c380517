// Poisson-disk sampling with a distance r(x, y) that varies over the ground; a function of the world.
//
// Two points p and q are no nearer than 2^min(a, b) (r_p + r_q) / 2, where a and b are their levels: all points keep
// the mean of their distances, and those of level j and above 2^j times that.
//
// Grids of cells with sides s, 2 s, 4 s ... are filled one after the other, the coarsest first. At a place of distance
// r the points of one grid have the one level a for which r 2^a lies within [s sqrt(2), 2 s sqrt(2)), so that a cell
// holds at most one of them and points of one grid conflict over at most REACH cells. Points of coarser grids that can
// conflict with anything a cell may throw are listed for the cell beforehand: some of those of its parent cell, and some
// of the parent's neighbours. Rounds of darts are as in poisson.cl. Only + - * and conversions touch distances, so every
// device gives the same points.
//
// Lengths are in shares of a cell's side, 1 / SIDE, of the grid at hand: they double from a grid to the next finer one.

#include "poisson.clh"
#pragma OPENCL FP_CONTRACT OFF

#define REACH 3  // cells: points of one grid farther apart can't conflict, nor can those of cells 3 away both ways
#define AT_ONCE 4
#define LISTED 16                // points of coarser grids that a cell's list holds
#define OVERFLOW 255             // a list that would need more: nothing may be thrown here
#define LEAST 5792.6187f         // SIDE sqrt(2): the least distance of a grid's points at their level
#define GREATEST 11585.2375f     // twice that, which is more than any
#define ROUNDING 1.41421356f     // lattice units that two points may come nearer by rounding them
#define MARGIN 1.000002f         // of a squared distance, for the rounding of floats

// How far a row of cells j rows away can conflict: REACH, but for the corners.
#define SPAN(j) ((j) == -REACH || (j) == REACH ? REACH - 1 : REACH)

// The distance over the ground, lattice units: bilinear between vertices 2^bits lattice units apart.
typedef struct {
    __global const float *spacing;
    int width, bits;
    long west, south;  // of the first vertex, lattice units
    float most;        // nothing stands where it is more
} Raster;

#define RASTER_ARGUMENTS \
    __global const float *spacing, int raster_width, int raster_bits, long raster_west, long raster_south, float most
#define COLLECT_RASTER const Raster raster = {spacing, raster_width, raster_bits, raster_west, raster_south, most};

inline float spacing_at(Raster r, long x, long y)
{
    const long east = x - r.west;
    const long north = y - r.south;
    const int at = (int)(north >> r.bits) * r.width + (int)(east >> r.bits);
    const long mask = (1L << r.bits) - 1;
    const float unit = 1.0f / (float)(1 << r.bits);
    const float u = (float)(int)(east & mask) * unit;
    const float v = (float)(int)(north & mask) * unit;
    const float south = r.spacing[at] + (r.spacing[at + 1] - r.spacing[at]) * u;
    const float above = r.spacing[at + r.width] + (r.spacing[at + r.width + 1] - r.spacing[at + r.width]) * u;
    return south + (above - south) * v;
}

// Half the distance of a dart and 2^level, or the level 0 if the grid at hand has none for its place.
//   scale    shares of a cell's side in a lattice unit
//   levels   the highest level there may be
inline float2 grade_of(Raster raster, long x, long y, float scale, int levels)
{
    const float spacing = spacing_at(raster, x, y);
    const float distance = (spacing + ROUNDING) * scale;
    float reached = distance;
    float times = 1.0f;
    int level = 0;
    while (reached < LEAST) {
        reached *= 2.0f;
        times *= 2.0f;
        ++level;
    }
    const bool here = reached < GREATEST && level <= levels && spacing <= raster.most;
    return (float2)(0.5f * distance, here ? times : 0.0f);
}

inline int conflict(float dx, float dy, float half_p, float times_p, float half_q, float times_q)
{
    const float distance = (times_p < times_q ? times_p : times_q) * (half_p + half_q);
    return dx * dx + dy * dy < distance * distance * MARGIN;
}

// A window's points: where they lie in their cells (x EMPTY: none), half their distance, and 2^level.
#define POINT_ARGUMENTS \
    __global short *x, __global short *y, __global float *half_distance, __global float *times

// Starts a window empty and lists what coarser grids hold near each cell; nothing where `coarse_width` is 0.
//   near         float4 a cell and place in its list: where from its south-west corner, half its distance, 2^level
//   listed       uchar a cell: how many, or OVERFLOW
//   coarse_*     the next coarser window, whose first cell is (coarse_west, coarse_south)
// Global size: (width rounded up, height).
__kernel void list_coarser(POINT_ARGUMENTS, __global float4 *near, __global uchar *listed, int width, int height,
                           long west, long south, __global const short *coarse_x, __global const short *coarse_y,
                           __global const float *coarse_half, __global const float *coarse_times,
                           __global const float4 *coarse_near, __global const uchar *coarse_listed, int coarse_width,
                           int coarse_height, long coarse_west, long coarse_south)
{
    const int i = get_global_id(0);
    const int j = get_global_id(1);
    if (i >= width) return;
    const int at = j * width + i;
    const int cells = width * height;
    x[at] = EMPTY;
    y[at] = 0;
    int many = 0;
    if (coarse_width > 0) {
        const long column = west + i;
        const long row = south + j;
        const int parent_i = (int)((column >> 1) - coarse_west);
        const int parent_j = (int)((row >> 1) - coarse_south);
        const int parent = parent_j * coarse_width + parent_i;
        const int coarse_cells = coarse_width * coarse_height;
        // From the parent's corner to this cell's.
        const float off_x = (float)((int)(column & 1) * SIDE);
        const float off_y = (float)((int)(row & 1) * SIDE);
        const int inherited = coarse_listed[parent];
        const int neighbours = (2 * REACH + 1) * (2 * REACH + 1);
        const int candidates = inherited == OVERFLOW ? 0 : inherited + neighbours;
        many = inherited == OVERFLOW ? OVERFLOW : 0;
        for (int k = 0; k < candidates; ++k) {
            float4 q;
            if (k < inherited) {
                q = coarse_near[k * coarse_cells + parent];
            } else {
                const int di = (k - inherited) % (2 * REACH + 1) - REACH;
                const int dj = (k - inherited) / (2 * REACH + 1) - REACH;
                const int there = (parent_j + dj) * coarse_width + parent_i + di;
                if (coarse_x[there] == EMPTY) continue;
                q = (float4)((float)(di * SIDE + coarse_x[there]), (float)(dj * SIDE + coarse_y[there]),
                             coarse_half[there], coarse_times[there]);
            }
            q.s012 *= 2.0f;
            q.s0 -= off_x;
            q.s1 -= off_y;
            // From the cell to the point, and the most that the two may have to keep.
            const float dx = fmax(fmax(-q.s0, q.s0 - SIDE), 0.0f);
            const float dy = fmax(fmax(-q.s1, q.s1 - SIDE), 0.0f);
            const float most = (LEAST + q.s2 * q.s3) * MARGIN;
            if (dx * dx + dy * dy >= most * most) continue;
            if (many < LISTED) near[many * cells + at] = q;
            many = many < LISTED ? many + 1 : OVERFLOW;
            if (many == OVERFLOW) break;
        }
    }
    listed[at] = (uchar)many;
}

// The candidate of a cell: its first dart, of `tries` (a multiple of AT_ONCE) from number `start` on, that is free.
//   candidate_*  as the points, written; time  uint a cell, written: when it was thrown, NEVER without one
//   side         of a cell, lattice units
// Global size: (width - 2 rim rounded up, height - 2 rim).
__kernel void throw_graded(POINT_ARGUMENTS, __global short *candidate_x, __global short *candidate_y,
                           __global float *candidate_half, __global float *candidate_times, __global uint *time,
                           __global const float4 *near, __global const uchar *listed, RASTER_ARGUMENTS, int width,
                           int height, int rim, long west, long south, uint salt, long side, float scale, int levels,
                           int start, int tries)
{
    COLLECT_RASTER
    const int i = get_global_id(0) + rim;
    const int j = get_global_id(1) + rim;
    if (i >= width - rim) return;
    const int at = j * width + i;
    const int cells = width * height;
    const Window w = {west, south, salt};
    const uint cell = cell_hash(w, i, j);
    const long corner_x = (west + i) * side;
    const long corner_y = (south + j) * side;
    const int many = listed[at];
    const int taken = x[at] != EMPTY || many == OVERFLOW;
    int found_x = EMPTY, found_y = 0;
    float found_half = 0.0f, found_times = 0.0f;
    uint found = NEVER;
    for (int number = start; number < start + tries; number += AT_ONCE) {
        uint bits[AT_ONCE];
        float px[AT_ONCE], py[AT_ONCE], half_p[AT_ONCE], times_p[AT_ONCE];
        int blocked[AT_ONCE];
        int open = 0;
        #pragma unroll
        for (int k = 0; k < AT_ONCE; ++k) {
            bits[k] = dart(cell, number + k);
            const long across = (dart_x(bits[k]) * side) >> SIDE_BITS;
            const long along = (dart_y(bits[k]) * side) >> SIDE_BITS;
            const float2 grade = grade_of(raster, corner_x + across, corner_y + along, scale, levels);
            px[k] = (float)dart_x(bits[k]);
            py[k] = (float)dart_y(bits[k]);
            half_p[k] = grade.s0;
            times_p[k] = grade.s1;
            blocked[k] = taken | (times_p[k] == 0.0f) | (number + k >= start + tries) | (found != NEVER);
            open |= !blocked[k];
        }
        if (open) {
            for (int n = 0; n < many; ++n) {
                const float4 q = near[n * cells + at];
                #pragma unroll
                for (int k = 0; k < AT_ONCE; ++k) {
                    blocked[k] |= conflict(q.s0 - px[k], q.s1 - py[k], half_p[k], times_p[k], q.s2, q.s3);
                }
            }
            #pragma unroll
            for (int dj = -REACH; dj <= REACH; ++dj) {
                #pragma unroll
                for (int di = -SPAN(dj); di <= SPAN(dj); ++di) {
                    const int there = at + dj * width + di;
                    const float qx = (float)(x[there] + di * SIDE);
                    const float qy = (float)(y[there] + dj * SIDE);
                    const float half_q = half_distance[there];
                    const float times_q = times[there];
                    #pragma unroll
                    for (int k = 0; k < AT_ONCE; ++k) {
                        blocked[k] |= conflict(qx - px[k], qy - py[k], half_p[k], times_p[k], half_q, times_q);
                    }
                }
            }
            #pragma unroll
            for (int k = 0; k < AT_ONCE; ++k) {
                const int first = !blocked[k] & (found == NEVER);
                found_x = first ? dart_x(bits[k]) : found_x;
                found_y = first ? dart_y(bits[k]) : found_y;
                found_half = first ? half_p[k] : found_half;
                found_times = first ? times_p[k] : found_times;
                found = first ? dart_time(bits[k], number + k) : found;
            }
        }
    }
    candidate_x[at] = (short)found_x;
    candidate_y[at] = (short)found_y;
    candidate_half[at] = found_half;
    candidate_times[at] = found_times;
    time[at] = found;
}

// Accepts each candidate that is the earliest among those it conflicts with.
// Global size: as `throw_graded`, with a rim wider by REACH.
__kernel void accept_graded(POINT_ARGUMENTS, __global const short *candidate_x, __global const short *candidate_y,
                            __global const float *candidate_half, __global const float *candidate_times,
                            __global const uint *time, int width, int rim)
{
    const int i = get_global_id(0) + rim;
    const int j = get_global_id(1) + rim;
    if (i >= width - rim) return;
    const int at = j * width + i;
    if (candidate_x[at] == EMPTY) return;
    const float px = (float)candidate_x[at];
    const float py = (float)candidate_y[at];
    const float half_p = candidate_half[at];
    const float times_p = candidate_times[at];
    const uint own = time[at];
    int beaten = 0;
    #pragma unroll
    for (int dj = -REACH; dj <= REACH; ++dj) {
        #pragma unroll
        for (int di = -SPAN(dj); di <= SPAN(dj); ++di) {
            const int there = at + dj * width + di;
            const float dx = (float)(candidate_x[there] + di * SIDE) - px;
            const float dy = (float)(candidate_y[there] + dj * SIDE) - py;
            beaten |= earlier(time[there], own, di, dj)
                      & conflict(dx, dy, half_p, times_p, candidate_half[there], candidate_times[there]);
        }
    }
    if (beaten) return;
    x[at] = candidate_x[at];
    y[at] = candidate_y[at];
    half_distance[at] = half_p;
    times[at] = times_p;
}

#include "poisson_collect.clh"

// The points of each piece, from where it starts.
//   start   int a piece: how many points all before it have
//   point   long2 a point, written: lattice units
//   of      float2 a point, written: its distance, lattice units, and 2^level
__kernel void write_graded(POINT_ARGUMENTS, int width, int rim, long west, long south, long cell, long4 area,
                           int length, RASTER_ARGUMENTS, __global const int *start, __global long2 *point,
                           __global float2 *of)
{
    COLLECT_RASTER
    int next = start[get_global_id(1) * get_global_size(0) + get_global_id(0)];
    FOR_POINTS_OF_PIECE
        point[next] = p;
        of[next] = (float2)(spacing_at(raster, p.s0, p.s1), times[at]);
        ++next;
    }
}
