// Poisson-disk sampling with a distance r(x, y) that varies over the ground; a function of the world.
//
// Two points p and q are no nearer than 2^min(a, b) (r_p + r_q) / 2, where a and b are their levels: all points are
// at least the mean of their distances apart, and those of level j and above 2^j times that.
//
// Grids of cells with sides s, 2 s, 4 s ... are filled one after the other, the coarsest first. At a position of distance
// r the points of one grid have the one level a for which r 2^a is in [s sqrt(2), 2 s sqrt(2)), so that a cell
// holds at most one of them and points of one grid conflict over at most REACH cells. Points of coarser grids that can
// conflict with a dart thrown into a cell are listed for the cell beforehand, filtered from the lists of its parent cell
// and of that cell's neighbours. Rounds of darts: docs/kernels/poisson.md. Only + - * and conversions touch
// distances, so every device gives the same points.
//
// Lengths are in shares of a cell's side, 1 / SIDE, of the current grid: they double from a grid to the next finer one.

#include "poisson.clh"
#include "real.clh"

#define REACH 3  // cells: points of one grid farther apart can't conflict, nor can those of cells 3 away both ways
#define MOST_AT_ONCE 4
#define LISTED 24                // points of coarser grids that a list holds
#define OVERFLOW 255             // a list that would need more: nothing may be thrown here
#define LEAST 5792.6187f         // SIDE sqrt(2): the least distance of a grid's points at their level
#define GREATEST 11585.2375f     // twice that, which is more than any
#define ROUNDING 1.41421356f     // lattice units that two points may come nearer by rounding them
#define MARGIN 1.000002f         // of a squared distance, for the rounding of floats

// The distance over the ground, lattice units: bilinear between vertices 2^bits lattice units apart.
typedef struct {
    __global const float *spacing;
    int width, bits;
    long west, south;  // of the first vertex, lattice units
    float most;        // no points where it is more
} Raster;

#define RASTER_ARGUMENTS \
    __global const float *spacing, int raster_width, int raster_bits, long raster_west, long raster_south, float most
#define COLLECT_RASTER const Raster raster = {spacing, raster_width, raster_bits, raster_west, raster_south, most};

INLINE float spacing_at(Raster r, long x, long y)
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
INLINE float2 grade_of(Raster raster, long x, long y, float scale, int levels)
{
    const float spacing = spacing_at(raster, x, y);
    const float distance = (spacing + ROUNDING) * scale;
    float reached = distance;
    float times = 1.0f;
    for (int level = 0; level < levels; ++level) {
        const float factor = reached < LEAST ? 2.0f : 1.0f;
        reached *= factor;
        times *= factor;
    }
    const bool here = reached >= LEAST && reached < GREATEST && spacing <= raster.most;
    return (float2)(0.5f * distance, here ? times : 0.0f);
}

INLINE int conflict(float dx, float dy, float half_p, float times_p, float half_q, float times_q)
{
    const float distance = (times_p < times_q ? times_p : times_q) * (half_p + half_q);
    return dx * dx + dy * dy < distance * distance * MARGIN;
}

// Only blocks of a window are worked on, those where the raster leaves something to do: BLOCK_COLUMNS by BLOCK_ROWS cells
// from the cell blocks[n] on. Global size: (BLOCK_COLUMNS, number of blocks times BLOCK_ROWS).
//   rim   cells at the window's border that are left out
#define BLOCK_COLUMNS 32
#define BLOCK_ROWS 8
#define BLOCK_ARGUMENTS __global const int2 *blocks, int width, int height, int rim
#define CELL_OF_BLOCK                                                   \
    const int2 block = blocks[(uint)get_global_id(1) / BLOCK_ROWS];     \
    const int j = block.s1 + (int)((uint)get_global_id(1) % BLOCK_ROWS); \
    if (j < rim || j >= height - rim) return;                           \
    const int i = block.s0 + (int)get_global_id(0);                     \
    if (i < rim || i >= width - rim) return;                            \
    const int at = j * width + i;

// A window's points: positions in their cells (x EMPTY: none), half their distance, and 2^level.
#define POINT_ARGUMENTS \
    __global short *x, __global short *y, __global float *half_distance, __global float *times

// Lists of a grid's coarser points: one for every four of its cells that are one of the next coarser grid's.
//   near      LISTED times four planes of a float a coarse cell: offset of a point from the cell's south-west corner,
//             half its distance, 2^level; lengths as in the finer grid
//   listed    uchar a coarse cell: how many, or OVERFLOW
//   width, height, west, south  of the coarser window, 0 without one
typedef struct {
    __global const float *near;
    __global const uchar *listed;
    int width, height;
    long west, south;
} Lists;

#define LIST_ARGUMENTS \
    __global const float *near, __global const uchar *listed, int list_width, int list_height, long list_west, long list_south
#define COLLECT_LISTS const Lists lists = {near, listed, list_width, list_height, list_west, list_south};

// Index of a cell's list.
INLINE int list_of(Lists lists, long column, long row)
{
    return (int)((row >> 1) - lists.south) * lists.width + (int)((column >> 1) - lists.west);
}

INLINE float4 listed_point(Lists lists, int list, int n)
{
    const size_t plane = lists.width * lists.height;
    __global const float *first = lists.near + 4 * n * plane + list;
    return (float4)(first[0], first[plane], first[2 * plane], first[3 * plane]);
}

// Puts a point on a list if a dart in the list's cell can conflict with it: if it is nearer to the cell than the
// greatest required distance. Returns the number of listed points, more than LISTED on overflow.
__attribute__((always_inline)) inline int list(__global float *near, size_t plane, int at, int many, float4 q)
{
    const float side = 2 * SIDE;
    const float dx = real_max(real_max(-q.s0, q.s0 - side), 0.0f);
    const float dy = real_max(real_max(-q.s1, q.s1 - side), 0.0f);
    const float most = LEAST + q.s2 * q.s3;
    if (dx * dx + dy * dy >= most * most * MARGIN) return many;
    if (many < LISTED) {
        __global float *first = near + 4 * many * plane + at;
        first[0] = q.s0;
        first[plane] = q.s1;
        first[2 * plane] = q.s2;
        first[3 * plane] = q.s3;
    }
    return many + 1;
}

// Lists for a finer grid, from this grid's points and this grid's own lists.
//   finer_near, finer_listed   a list for each cell of this grid, written
__kernel void list_for_finer(BLOCK_ARGUMENTS, POINT_ARGUMENTS, LIST_ARGUMENTS, __global float *finer_near,
                             __global uchar *finer_listed, long west, long south)
{
    COLLECT_LISTS
    CELL_OF_BLOCK
    const size_t plane = width * height;
    int many = 0;
    if (lists.width > 0) {
        const long column = west + i;
        const long row = south + j;
        const int own = list_of(lists, column, row);
        const int known = lists.listed[own];
        many = known == OVERFLOW ? LISTED + 1 : 0;
        for (int n = 0; n < (known == OVERFLOW ? 0 : known); ++n) {
            float4 q = listed_point(lists, own, n);
            q.s0 -= (float)((int)(column & 1) * SIDE);
            q.s1 -= (float)((int)(row & 1) * SIDE);
            q.s012 *= 2.0f;
            many = list(finer_near, plane, at, many, q);
        }
    }
    for (int dj = -REACH; dj <= REACH; ++dj) {
        // The finer grid's points conflict with this one's over less than 1.5 LEAST, 2.13 cells.
        const int span = REACH - (dj * dj > 1) - (dj * dj > 4);
        for (int di = -span; di <= span; ++di) {
            const int there = at + dj * width + di;
            if (x[there] == EMPTY) continue;
            const float4 q = {2.0f * (float)(di * SIDE + x[there]), 2.0f * (float)(dj * SIDE + y[there]),
                              2.0f * half_distance[there], times[there]};
            many = list(finer_near, plane, at, many, q);
        }
    }
    finer_listed[at] = (uchar)(many > LISTED ? OVERFLOW : many);
}

// Starts a window without points, candidates and lists. What has the level 0 conflicts with nothing; the halves are
// cleared for speed: whatever stood there could be denormal. Global size: (width rounded up, height).
__kernel void clear(__global short *x, __global float *half_distance, __global float *times,
                    __global short *candidate_x, __global float *candidate_half, __global float *candidate_times,
                    __global uchar *finer_listed, int width)
{
    const int i = get_global_id(0);
    if (i >= width) return;
    const int at = get_global_id(1) * width + i;
    x[at] = EMPTY;
    half_distance[at] = 0.0f;
    times[at] = 0.0f;
    candidate_x[at] = EMPTY;
    candidate_half[at] = 0.0f;
    candidate_times[at] = 0.0f;
    finer_listed[at] = 0;
}

// The candidate of a cell: its first dart, of `tries` from number `start` on, that is free. `at_once`, a literal,
// of them are compared with each point that is loaded.
__attribute__((always_inline)) inline void throw_darts(
    POINT_ARGUMENTS, __global short *candidate_x, __global short *candidate_y, __global float *candidate_half,
    __global float *candidate_times, __global uint *time, Lists lists, Raster raster, BLOCK_ARGUMENTS, Window w,
    long side, float scale, int levels, int start, int tries, const int at_once)
{
    CELL_OF_BLOCK
    const uint cell = cell_hash(w, i, j);
    const long corner_x = (w.west + i) * side;
    const long corner_y = (w.south + j) * side;
    const float off_x = (float)((int)((w.west + i) & 1) * SIDE);
    const float off_y = (float)((int)((w.south + j) & 1) * SIDE);
    const int list = lists.width > 0 ? list_of(lists, w.west + i, w.south + j) : 0;
    const int known = lists.width > 0 ? lists.listed[list] : 0;
    const int many = known == OVERFLOW ? 0 : known;
    const int occupied = x[at] != EMPTY || known == OVERFLOW;
    int found_x = EMPTY, found_y = 0;
    float found_half = 0.0f, found_times = 0.0f;
    uint found = NEVER;
    for (int number = start; number < start + tries && !occupied && found == NEVER; number += at_once) {
        uint bits[MOST_AT_ONCE];
        float px[MOST_AT_ONCE], py[MOST_AT_ONCE], half_p[MOST_AT_ONCE], times_p[MOST_AT_ONCE];
        int blocked[MOST_AT_ONCE];
        int all = 1;  // are blocked: the rest is skipped
        #pragma unroll
        for (int k = 0; k < at_once; ++k) {
            bits[k] = dart(cell, number + k);
            const long across = (dart_x(bits[k]) * side) >> SIDE_BITS;
            const long along = (dart_y(bits[k]) * side) >> SIDE_BITS;
            const float2 grade = grade_of(raster, corner_x + across, corner_y + along, scale, levels);
            px[k] = (float)dart_x(bits[k]);
            py[k] = (float)dart_y(bits[k]);
            half_p[k] = grade.s0;
            times_p[k] = grade.s1;
            blocked[k] = times_p[k] == 0.0f;
            all &= blocked[k];
        }
        for (int n = 0; n < many && !all; ++n) {
            all = 1;
            const float4 q = listed_point(lists, list, n);
            const float qx = q.s0 - off_x;
            const float qy = q.s1 - off_y;
            #pragma unroll
            for (int k = 0; k < at_once; ++k) {
                blocked[k] |= conflict(qx - px[k], qy - py[k], half_p[k], times_p[k], q.s2, q.s3);
                all &= blocked[k];
            }
        }
        if (start > 0) {  // before that the grid is empty
            for (int n = 0; n < 2 * REACH + 1 && !all; ++n) {
                const int dj = n & 1 ? (n + 1) / 2 : -n / 2;  // near rows first
                #pragma unroll
                for (int di = -REACH; di <= REACH; ++di) {
                    const int there = at + dj * width + di;
                    const float qx = (float)(x[there] + di * SIDE);
                    const float qy = (float)(y[there] + dj * SIDE);
                    const float half_q = half_distance[there];
                    const float times_q = times[there];
                    #pragma unroll
                    for (int k = 0; k < at_once; ++k) {
                        blocked[k] |= conflict(qx - px[k], qy - py[k], half_p[k], times_p[k], half_q, times_q);
                    }
                }
                all = 1;
                #pragma unroll
                for (int k = 0; k < at_once; ++k) all &= blocked[k];
            }
        }
        #pragma unroll
        for (int k = 0; k < at_once; ++k) {
            const int first = !blocked[k] & (found == NEVER);
            found_x = first ? dart_x(bits[k]) : found_x;
            found_y = first ? dart_y(bits[k]) : found_y;
            found_half = first ? half_p[k] : found_half;
            found_times = first ? times_p[k] : found_times;
            found = first ? dart_time(bits[k], number + k) : found;
        }
    }
    candidate_x[at] = (short)found_x;
    candidate_y[at] = (short)found_y;
    candidate_half[at] = found_half;
    candidate_times[at] = found_times;
    time[at] = found;
}

#define THROW_ARGUMENTS                                                                                              \
    POINT_ARGUMENTS, __global short *candidate_x, __global short *candidate_y, __global float *candidate_half,       \
        __global float *candidate_times, __global uint *time, LIST_ARGUMENTS, RASTER_ARGUMENTS, BLOCK_ARGUMENTS,  \
        long west, long south, uint salt, long side, float scale, int levels, int start, int tries
#define THROW(at_once)                                                                                               \
    COLLECT_RASTER                                                                                                   \
    const Window w = {west, south, salt};                                                                            \
    COLLECT_LISTS                                                                                                  \
    throw_darts(x, y, half_distance, times, candidate_x, candidate_y, candidate_half, candidate_times, time, lists,  \
                raster, blocks, width, height, rim, w, side, scale, levels, start, tries, at_once);

//   candidate_*  as the points, written
//   time         uint a cell, written: when the candidate was thrown, NEVER without one
//   side         of a cell, lattice units
//   start, tries first dart and number of darts; a multiple of those thrown at once
__kernel void throw_one_graded(THROW_ARGUMENTS) { THROW(1) }
__kernel void throw_two_graded(THROW_ARGUMENTS) { THROW(2) }
__kernel void throw_four_graded(THROW_ARGUMENTS) { THROW(4) }

// Accepts each candidate that is the earliest among those it conflicts with.
__kernel void accept_graded(BLOCK_ARGUMENTS, POINT_ARGUMENTS, __global const short *candidate_x,
                            __global const short *candidate_y,
                            __global const float *candidate_half, __global const float *candidate_times,
                            __global const uint *time)
{
    CELL_OF_BLOCK
    const float px = (float)candidate_x[at];
    const float py = (float)candidate_y[at];
    const float half_p = candidate_half[at];
    const float times_p = candidate_times[at];
    const uint own = time[at];
    int rejected = candidate_x[at] == EMPTY;
    // Row by row, and no further than needed: most cells have no candidate.
    for (int dj = -REACH; dj <= REACH && !rejected; ++dj) {
        #pragma unroll
        for (int di = -REACH; di <= REACH; ++di) {
            const int there = at + dj * width + di;
            const float dx = (float)(candidate_x[there] + di * SIDE) - px;
            const float dy = (float)(candidate_y[there] + dj * SIDE) - py;
            rejected |= earlier(time[there], own, di, dj)
                      & conflict(dx, dy, half_p, times_p, candidate_half[there], candidate_times[there]);
        }
    }
    if (rejected) return;
    x[at] = candidate_x[at];
    y[at] = candidate_y[at];
    half_distance[at] = half_p;
    times[at] = times_p;
}

#include "poisson_collect.clh"

// The points of each piece, from where it starts.
//   start   int a piece: number of points in all pieces before it
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
