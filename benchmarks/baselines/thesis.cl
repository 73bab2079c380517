// Tiles in the way of Zaaijer 2013, chapters 3 and 7: the baseline that the terrain's own kernels are compared with.
// Noise from a permutation table, every octave at every level, positions in metres as floating point, distances by
// square roots, the nearest place on a spline by sampling it again and again, normals by finite differences. It is
// written as one writes it for a GPU, branches included; REAL=double with dense sampling is its own reference.
#include "real.clh"

#define UNSKEW R(0.21132486540518713)  // (3 - sqrt 3) / 6
#define SKEWED R(0.3660254037844386)   // (sqrt 3 - 1) / 2
#define HILL_OCTAVES 6                 // "several" in section 3.5

// One of eight directions from the table, as in Perlin's simplex noise (Gustavson 2005).
inline REAL corner(__global const int *permutation, int i, int j, REAL dx, REAL dy)
{
    REAL fade = R(0.5) - dx * dx - dy * dy;
    if (fade < R(0)) return R(0);
    const int direction = permutation[(i & 255) + permutation[j & 255]] & 7;
    const REAL u = direction < 4 ? dx : dy;
    const REAL v = direction < 4 ? dy : dx;
    fade *= fade;
    return fade * fade * ((direction & 1 ? -u : u) + (direction & 2 ? R(-2) * v : R(2) * v));
}

inline REAL simplex(__global const int *permutation, REAL x, REAL y)
{
    const REAL skewed = (x + y) * SKEWED;
    const REAL i = floor(x + skewed);
    const REAL j = floor(y + skewed);
    const REAL unskewed = (i + j) * UNSKEW;
    const REAL dx = x - (i - unskewed);
    const REAL dy = y - (j - unskewed);
    const int across = dx > dy;
    REAL sum = corner(permutation, (int)i, (int)j, dx, dy);
    sum += corner(permutation, (int)i + across, (int)j + 1 - across, dx - across + UNSKEW, dy - 1 + across + UNSKEW);
    sum += corner(permutation, (int)i + 1, (int)j + 1, dx - 1 + 2 * UNSKEW, dy - 1 + 2 * UNSKEW);
    return R(40) * sum;
}

// NoiseOctaves of section 3.5: its first octave has amplitude 1, each next one is `gain` times that.
inline REAL fractal(__global const int *permutation, REAL x, REAL y, int octaves, REAL gain)
{
    REAL sum = R(0), amplitude = R(1), frequency = R(1);
    for (int i = 0; i < octaves; ++i) {
        sum += amplitude * simplex(permutation, x * frequency, y * frequency);
        frequency *= 2;
        amplitude *= gain;
    }
    return sum;
}

// A Catmull-Rom segment at t: x, y, height of the water, half width.
inline REAL4 spline_at(__global const REAL4 *p, REAL t)
{
    const REAL4 a = R(2) * p[1];
    const REAL4 b = p[2] - p[0];
    const REAL4 c = R(2) * p[0] - R(5) * p[1] + R(4) * p[2] - p[3];
    const REAL4 d = R(3) * p[1] - p[0] - R(3) * p[2] + p[3];
    return R(0.5) * (a + t * (b + t * (c + t * d)));
}

// Heights of one tile with a border of one vertex, row 0 northernmost.
//   permutation  512: the numbers 0 ... 255, shuffled, twice
//   feature      REAL4: x, y, radius, height, m; the first `hills` of them are hills, the others mountains
//   segment      4 REAL4 each: control points x, y, height of the water, half width
//   reach        one a segment, m: how far the river's valley reaches there; depth: of its bed, m
//   samples      of a segment in each of `rounds`; a round looks around the best sample of the one before
// Global size: (side, side).
__kernel void thesis_heights(__global const int *permutation, int octaves, REAL wavelength, REAL gain, REAL relief,
                             __global const REAL4 *feature, int hills, int features,
                             __global const REAL4 *segment, int segments,
                             __global const REAL *reach, REAL depth, int samples, int rounds, REAL west, REAL north, REAL spacing,
                             int side, __global REAL *height)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    const REAL x = west + (column - 1) * spacing;
    const REAL y = north - (row - 1) * spacing;

    REAL z = relief * (R(1) - gain) * fractal(permutation, x / wavelength, y / wavelength, octaves, gain);
    for (int k = 0; k < features; ++k) {
        const REAL4 f = feature[k];
        const REAL t = sqrt((x - f.s0) * (x - f.s0) + (y - f.s1) * (y - f.s1)) / f.s2;
        if (t < R(1)) {
            // A fractal of its own gives each feature a distinct and natural look: hills as a multiplier, mountains
            // down to the finest detail and by a sum of cubics of which one has a sharp tip.
            const REAL own = fractal(permutation, x / f.s2 + k, y / f.s2 - k, k < hills ? HILL_OCTAVES : octaves, gain);
            if (k < hills) z += f.s3 * cubic(t) * (R(1) + R(0.2) * own);
            else z += f.s3 * (R(0.7) * cubic(t) + R(0.3) * cubic(2 * t) + R(0.1) * (cubic(t) + cubic(sqrt(t))) * own);
        }
    }

    REAL nearest = R(1e30), wide = R(0);
    REAL4 at = (REAL4)(R(0));
    for (int k = 0; k < segments; ++k) {
        REAL low = R(0), high = R(1);
        for (int round = 0; round < rounds; ++round) {
            const REAL step = (high - low) / samples;
            REAL best = R(1e30);
            REAL best_t = low;
            for (int i = 0; i <= samples; ++i) {
                const REAL t = low + i * step;
                const REAL4 p = spline_at(segment + 4 * k, t);
                const REAL d = sqrt((x - p.s0) * (x - p.s0) + (y - p.s1) * (y - p.s1));
                if (d < best) {
                    best = d;
                    best_t = t;
                }
                if (d < nearest) {
                    nearest = d;
                    at = p;
                    wide = reach[k];
                }
            }
            low = real_max(best_t - step, R(0));
            high = real_min(best_t + step, R(1));
        }
    }
    if (nearest < wide) {
        // z = b z_enforced + (1 - b) z_terrain: a bed, and from the water's edge on the water's height.
        const REAL across = nearest / at.s3;
        const REAL bed = at.s2 - depth * real_max(R(1) - across * across, R(0));
        const REAL b = cubic(real_max(nearest - at.s3, R(0)) / (wide - at.s3));
        z = b * bed + (R(1) - b) * z;
    }
    height[row * side + column] = z;
}

// Unit normals of a tile by central differences of its heights, and the heights without their border, written to the
// place of that number.
// Global size: (side - 2, side - 2).
__kernel void thesis_normals(__global const REAL *height, int side, REAL spacing, int tile, __global REAL *inner,
                             __global REAL *normal)
{
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    __global const REAL *z = height + (row + 1) * side + column + 1;
    const REAL east = (z[1] - z[-1]) / (2 * spacing);
    const REAL north = (z[-side] - z[side]) / (2 * spacing);
    const REAL up = R(1) / sqrt(R(1) + east * east + north * north);
    const int at = (tile * (side - 2) + row) * (side - 2) + column;
    inner[at] = z[0];
    normal[3 * at] = -east * up;
    normal[3 * at + 1] = -north * up;
    normal[3 * at + 2] = up;
}

// The same of many tiles at once, for heights that were evaluated in one launch.
// Global size: (side - 2, side - 2, tiles).
__kernel void normals_of_all(__global const REAL *height, int side, REAL inverse_span, __global REAL *ground)
{
    const size_t column = get_global_id(0);
    const size_t row = get_global_id(1);
    const size_t tile = get_global_id(2);
    const size_t inner = side - 2;
    __global const REAL *z = height + (tile * side + row + 1) * side + column + 1;
    const REAL east = (z[1] - z[-1]) * inverse_span;
    const REAL north = (z[-side] - z[side]) * inverse_span;
    const REAL up = inverse_sqrt(R(1) + east * east + north * north);
    vstore4((REAL4)(-east * up, -north * up, up, z[0]), (tile * inner + row) * inner + column, ground);
}
