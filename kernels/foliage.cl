// Poisson-disk sampling as a function of the world: no two points nearer than r, whatever rectangle is asked for.
//
// The world is cut into cells of side c <= r/sqrt(2), so that a cell holds at most one point. In each round
// every empty cell proposes one hashed candidate; a candidate that keeps its distance to all accepted points
// and beats every rival within r by its hashed priority is accepted. A decision reads cells up to four away,
// so n rounds need a halo of 4n cells and no order of work can change the result. Positions are integers
// (lattice units) and distances are compared exactly.

#define EMPTY (-1)
#define REACH 2  // cells: points further apart than that can't conflict

inline uint mixed(uint h)
{
    h ^= h >> 16;
    h *= 0x7FEB352Du;
    h ^= h >> 15;
    h *= 0x846CA68Bu;
    h ^= h >> 16;
    return h;
}

inline uint cell_hash(long column, long row, uint salt)
{
    uint h = mixed((uint)column + salt);
    h = mixed(h ^ ((uint)(column >> 32) + 0x9E3779B9u));
    h = mixed(h ^ (uint)row);
    return mixed(h ^ (uint)(row >> 32));
}

// Whether points a and b, in cells (column, row) apart, are nearer than r.
inline bool conflict(int2 a, int2 b, int columns, int rows, int cell, long r2)
{
    const long dx = (long)columns * cell + b.s0 - a.s0;
    const long dy = (long)rows * cell + b.s1 - a.s1;
    return dx * dx + dy * dy < r2;
}

// One candidate for each empty cell of a window of the world.
//   accepted   width * height int2: point within its cell, lattice units, or EMPTY
//   candidate  the same, written; priority  uint, written
//   west, south  the window's first cell, counted from the world's origin
//   cell       side of a cell, lattice units; r2 squared distance, lattice units squared
// Global size: (width, height).
__kernel void propose(__global const int2 *accepted, __global int2 *candidate, __global uint *priority,
                      int width, int height, long west, long south, int cell, long r2, uint salt)
{
    const int i = get_global_id(0);
    const int j = get_global_id(1);
    if (i >= width) return;
    const int at = j * width + i;
    const uint h = cell_hash(west + i, south + j, salt);
    int2 point = (int2)((int)(((ulong)mixed(h ^ 0x68E31DA4u) * (ulong)cell) >> 32),
                        (int)(((ulong)mixed(h ^ 0xB5297A4Du) * (ulong)cell) >> 32));
    priority[at] = h;
    if (accepted[at].s0 != EMPTY) point.s0 = EMPTY;
    for (int dj = -REACH; dj <= REACH && point.s0 != EMPTY; ++dj) {
        for (int di = -REACH; di <= REACH; ++di) {
            if (i + di < 0 || i + di >= width || j + dj < 0 || j + dj >= height) continue;
            const int2 other = accepted[at + dj * width + di];
            if (other.s0 != EMPTY && conflict(point, other, di, dj, cell, r2)) {
                point.s0 = EMPTY;
                break;
            }
        }
    }
    candidate[at] = point;
}

// Accepts each candidate that beats its rivals: by priority, then by place.
__kernel void resolve(__global int2 *accepted, __global const int2 *candidate, __global const uint *priority,
                      int width, int height, int cell, long r2)
{
    const int i = get_global_id(0);
    const int j = get_global_id(1);
    if (i >= width) return;
    const int at = j * width + i;
    const int2 point = candidate[at];
    if (point.s0 == EMPTY) return;
    const uint own = priority[at];
    for (int dj = -REACH; dj <= REACH; ++dj) {
        for (int di = -REACH; di <= REACH; ++di) {
            if (di == 0 && dj == 0) continue;
            if (i + di < 0 || i + di >= width || j + dj < 0 || j + dj >= height) continue;
            const int there = at + dj * width + di;
            const int2 other = candidate[there];
            if (other.s0 == EMPTY || !conflict(point, other, di, dj, cell, r2)) continue;
            if (priority[there] > own || (priority[there] == own && there > at)) return;
        }
    }
    accepted[at] = point;
}
