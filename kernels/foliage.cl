// Poisson-disk sampling as a function of the world: no two points nearer than r, whatever rectangle is asked for.
//
// The world is cut into cells of side c <= r/sqrt(2), so that a cell holds at most one point. In each round
// every empty cell proposes one hashed candidate; a candidate that keeps its distance to all accepted points
// and beats every rival within r by its hashed priority is accepted. A decision reads cells up to four away,
// so n rounds need a halo of 4n cells and no order of work can change the result. Positions are integers
// (lattice units) and distances are compared exactly.

#include "hash.clh"

#define EMPTY (-1)
#define REACH 2  // cells: points further apart than that can't conflict, nor can those of cells 2 apart both ways

inline uint cell_hash(long column, long row, uint salt)
{
    uint h = mixed((uint)column + salt);
    h = mixed(h ^ ((uint)(column >> 32) + 0x9E3779B9u));
    h = mixed(h ^ (uint)row);
    return mixed(h ^ (uint)(row >> 32));
}

// Whether b, in the cell (columns, rows) away, is nearer to a than r.
inline bool conflict(int2 a, int2 b, int columns, int rows, int cell, long r2)
{
    const long dx = columns * cell + b.s0 - a.s0;
    const long dy = rows * cell + b.s1 - a.s1;
    return b.s0 != EMPTY && dx * dx + dy * dy < r2;
}

// Both kernels work on a window of the world, rows of `width` cells; its rim of REACH cells stays EMPTY.
// Loops have no exits, so that drivers can run neighbouring cells in one vector.
// Global size: (width - 2 REACH rounded up, height - 2 REACH).

// One candidate for each empty cell.
//   accepted   int2 a cell: point within its cell, lattice units, or EMPTY
//   candidate  the same, written; priority  uint, written
//   west, south  the window's first cell, counted from the world's origin
//   cell       side of a cell, lattice units; r2 squared distance, lattice units squared
__kernel void propose(__global const int2 *accepted, __global int2 *candidate, __global uint *priority, int width,
                      long west, long south, int cell, long r2, uint salt)
{
    const int i = get_global_id(0) + REACH;
    const int j = get_global_id(1) + REACH;
    if (i >= width - REACH) return;
    const int at = j * width + i;
    const uint h = cell_hash(west + i, south + j, salt);
    const int2 point = (int2)((int)(((ulong)mixed(h ^ 0x68E31DA4u) * (ulong)cell) >> 32),
                              (int)(((ulong)mixed(h ^ 0xB5297A4Du) * (ulong)cell) >> 32));
    int blocked = accepted[at].s0 != EMPTY;
    for (int dj = -REACH; dj <= REACH; ++dj) {
        const int span = dj == -REACH || dj == REACH ? REACH - 1 : REACH;
        for (int di = -span; di <= span; ++di) {
            blocked |= conflict(point, accepted[at + dj * width + di], di, dj, cell, r2);
        }
    }
    priority[at] = h;
    candidate[at] = (int2)(blocked ? EMPTY : point.s0, point.s1);
}

// Accepts each candidate that beats its rivals: by priority, then by place.
__kernel void resolve(__global int2 *accepted, __global const int2 *candidate, __global const uint *priority,
                      int width, int cell, long r2)
{
    const int i = get_global_id(0) + REACH;
    const int j = get_global_id(1) + REACH;
    if (i >= width - REACH) return;
    const int at = j * width + i;
    const int2 point = candidate[at];
    const uint own = priority[at];
    int beaten = point.s0 == EMPTY;
    for (int dj = -REACH; dj <= REACH; ++dj) {
        const int span = dj == -REACH || dj == REACH ? REACH - 1 : REACH;
        for (int di = -span; di <= span; ++di) {
            const int there = at + dj * width + di;
            const bool first = priority[there] > own || (priority[there] == own && there > at);
            beaten |= first && conflict(point, candidate[there], di, dj, cell, r2);
        }
    }
    if (!beaten) accepted[at] = point;
}
