// Poisson-disk sampling with one distance r, by darts thrown in parallel; a function of the world.
//
// Cells have the side r / sqrt(2). In each round every empty cell throws darts; its first one that is no nearer than r
// to a point is its candidate, and a candidate is accepted if it is earlier than all candidates nearer than r. A cell's
// darts and their times are hashed from its position, so that no order of work changes the result; distances are
// compared as integers. This is dart throwing in the darts' order, except that a candidate rejected by a rejected one
// throws again. Levels: the points of a grid of cells twice as wide, sampled before at 2 r, stay in the finer one.

#include "poisson.clh"

#define REACH 2  // cells: points farther apart can't conflict, nor can those of cells 2 away both ways
#define MOST_AT_ONCE 4

// How far a row of cells j rows away can conflict: REACH, but for the corners.
#define SPAN(j) ((j) == -REACH || (j) == REACH ? REACH - 1 : REACH)

// The candidate of a cell: its first dart, of `tries` from number `start` on, that is free. `at_once`, a literal,
// of them are compared with each cell's point that is loaded; `bare`, a literal: the window has no point yet.
__attribute__((always_inline)) inline void throw_darts(
    __global const short *x, __global const short *y, __global short *candidate_x, __global short *candidate_y,
    __global uint *time, int width, int rim, Window w, int r2, int start, int tries, const int at_once, const int bare)
{
    const int i = get_global_id(0) + rim;
    const int j = get_global_id(1) + rim;
    if (i >= width - rim) return;
    const int at = j * width + i;
    const uint cell = cell_hash(w, i, j);
    const int occupied = x[at] != EMPTY;
    int found_x = EMPTY, found_y = 0;
    uint found = NEVER;
    for (int number = start; number < start + tries; number += at_once) {
        uint bits[MOST_AT_ONCE];
        int px[MOST_AT_ONCE], py[MOST_AT_ONCE], blocked[MOST_AT_ONCE];
        #pragma unroll
        for (int k = 0; k < at_once; ++k) {
            bits[k] = dart(cell, number + k);
            px[k] = dart_x(bits[k]);
            py[k] = dart_y(bits[k]);
            blocked[k] = occupied;
        }
        #pragma unroll
        for (int dj = -REACH; dj <= (bare ? -REACH - 1 : REACH); ++dj) {
            #pragma unroll
            for (int di = -SPAN(dj); di <= SPAN(dj); ++di) {
                const int there = at + dj * width + di;
                const int qx = x[there] + di * SIDE;
                const int qy = y[there] + dj * SIDE;
                #pragma unroll
                for (int k = 0; k < at_once; ++k) {
                    const int dx = qx - px[k];
                    const int dy = qy - py[k];
                    blocked[k] |= dx * dx + dy * dy < r2;
                }
            }
        }
        #pragma unroll
        for (int k = 0; k < at_once; ++k) {
            const int first = !blocked[k] & (found == NEVER);
            found_x = first ? px[k] : found_x;
            found_y = first ? py[k] : found_y;
            found = first ? dart_time(bits[k], number + k) : found;
        }
    }
    candidate_x[at] = (short)found_x;
    candidate_y[at] = (short)found_y;
    time[at] = found;
}

#define THROW_ARGUMENTS                                                                                          \
    __global const short *x, __global const short *y, __global short *candidate_x, __global short *candidate_y, \
        __global uint *time, int width, int rim, long west, long south, uint salt, int r2, int start, int tries
#define THROW(at_once, bare)                                                                                          \
    const Window w = {west, south, salt};                                                                       \
    throw_darts(x, y, candidate_x, candidate_y, time, width, rim, w, r2, start, tries, at_once, bare);

// All kernels work on cells no nearer than `rim` to the window's border.
// Global size: (width - 2 rim rounded up, height - 2 rim), but for `inherit` and those that collect.
//   x, y         short a cell: its point, x EMPTY where it has none
//   candidate_x, candidate_y  the same, written
//   time         uint a cell, written: when the candidate was thrown, NEVER without one
//   west, south  column and row of the window's first cell
//   r2           squared distance in shares of a cell's side, at most 2 SIDE^2
//   start, tries first dart and number of darts; a multiple of those thrown at once
__kernel void throw_first(THROW_ARGUMENTS) { THROW(1, 1) }
__kernel void throw_one(THROW_ARGUMENTS) { THROW(1, 0) }
__kernel void throw_two(THROW_ARGUMENTS) { THROW(2, 0) }
__kernel void throw_four(THROW_ARGUMENTS) { THROW(4, 0) }

// Accepts each candidate that is the earliest among those it conflicts with.
//   level     uchar a cell, written: the level at which its point was accepted
//   now       the level that is being filled
__kernel void accept(__global short *x, __global short *y, __global uchar *level, __global const short *candidate_x,
                     __global const short *candidate_y, __global const uint *time, int width, int rim, int r2, int now)
{
    const int i = get_global_id(0) + rim;
    const int j = get_global_id(1) + rim;
    if (i >= width - rim) return;
    const int at = j * width + i;
    const int px = candidate_x[at];
    const int py = candidate_y[at];
    const uint own = time[at];
    int rejected = px == EMPTY;
    #pragma unroll
    for (int dj = -REACH; dj <= REACH; ++dj) {
        #pragma unroll
        for (int di = -SPAN(dj); di <= SPAN(dj); ++di) {
            const int there = at + dj * width + di;
            const int dx = candidate_x[there] + di * SIDE - px;
            const int dy = candidate_y[there] + dj * SIDE - py;
            rejected |= earlier(time[there], own, di, dj) & (dx * dx + dy * dy < r2);
        }
    }
    x[at] = rejected ? x[at] : (short)px;
    y[at] = rejected ? y[at] : (short)py;
    level[at] = rejected ? level[at] : (uchar)now;
}

// Starts a window: with the points of a coarser one, or empty where that has the width 0.
//   coarse_*           the coarser window's, whose first cell is (coarse_west, coarse_south)
// Global size: (width rounded up, height).
__kernel void inherit(__global short *x, __global short *y, __global uchar *level, int width, long west, long south,
                      __global const short *coarse_x, __global const short *coarse_y,
                      __global const uchar *coarse_level, int coarse_width, long coarse_west, long coarse_south)
{
    const int i = get_global_id(0);
    const int j = get_global_id(1);
    if (i >= width) return;
    int2 point = (int2)(EMPTY, 0);
    uchar of_level = 0;
    if (coarse_width > 0) {
        const long column = west + i;
        const long row = south + j;
        const int from = (int)((row >> 1) - coarse_south) * coarse_width + (int)((column >> 1) - coarse_west);
        point = in_quarter(coarse_x[from], coarse_y[from], column, row);
        of_level = coarse_level[from];
    }
    const int at = j * width + i;
    x[at] = (short)point.s0;
    y[at] = (short)point.s1;
    level[at] = of_level;
}

#include "poisson_collect.clh"

// The points and their levels, from where each piece starts.
//   start   int a piece: number of points in all pieces before it
//   point   long2 a point, written: lattice units
//   of      uchar a point, written: its level
__kernel void write_points(__global const short *x, __global const short *y, __global const uchar *level, int width,
                           int rim, long west, long south, long cell, long4 area, int length,
                           __global const int *start, __global long2 *point, __global uchar *of)
{
    int next = start[get_global_id(1) * get_global_size(0) + get_global_id(0)];
    FOR_POINTS_OF_PIECE
        point[next] = p;
        of[next] = level[at];
        ++next;
    }
}
