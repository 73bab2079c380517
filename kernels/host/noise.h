/* Hashes of integer positions and noise made of them: the same bits wherever they are asked for.
 *
 * Bits are mixed by the finalizer of SplitMix64 (Steele, Lea & Flood, "Fast splittable pseudorandom number
 * generators", 2014). Gradient noise after Perlin, "Improving noise" (2002). Positions are mesh units.
 */
#pragma once

#include "host.h"

static inline uint64_t mixed(uint64_t state)
{
    state += UINT64_C(0x9E3779B97F4A7C15);
    state = (state ^ (state >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    state = (state ^ (state >> 27)) * UINT64_C(0x94D049BB133111EB);
    return state ^ (state >> 31);
}

/* 64 hashed bits of a pair of integers. */
static inline uint64_t hashed(uint64_t key, int64_t column, int64_t row)
{
    return mixed(mixed(key ^ mixed((uint64_t)column)) ^ (uint64_t)row);
}

/* Hashed bits as a number in [0, 1). */
static inline double unit(uint64_t bits) { return (double)(int64_t)(bits >> 11) * 0x1p-53; }

/* Value noise in [-1, 1] on cells of 2^bits units: the bilinear mean of their corners by 3 t² - 2 t³. */
static inline double value_noise(uint64_t key, int64_t x, int64_t y, int64_t bits)
{
    int64_t column = x >> bits, row = y >> bits, cell = INT64_C(1) << bits;
    double scale = 1.0 / (double)cell;
    double u = (double)(x - column * cell) * scale, v = (double)(y - row * cell) * scale;
    u = u * u * (3.0 - 2.0 * u);
    v = v * v * (3.0 - 2.0 * v);
    double a = unit(hashed(key, column, row)), b = unit(hashed(key, column + 1, row));
    double c = unit(hashed(key, column, row + 1)), d = unit(hashed(key, column + 1, row + 1));
    double south = a + u * (b - a), north = c + u * (d - c);
    return 2.0 * (south + v * (north - south)) - 1.0;
}

/* Height at (u, v) of the slope that is hashed to a lattice point. */
static inline double lattice_slope(uint64_t key, int64_t column, int64_t row, double u, double v)
{
    uint64_t bits = hashed(key, column, row);
    double east = (double)(int64_t)(bits & 0xFFFF) * 0x1p-15 - 1.0;
    double north = (double)(int64_t)((bits >> 16) & 0xFFFF) * 0x1p-15 - 1.0;
    return east * u + north * v;
}

/* Gradient noise at a point of the unit lattice, about -0.7 … 0.7, by 6 t⁵ - 15 t⁴ + 10 t³. */
static inline double gradient_noise(uint64_t key, double x, double y)
{
    int64_t column = (int64_t)floor(x), row = (int64_t)floor(y);
    double u = x - (double)column, v = y - (double)row;
    double a = lattice_slope(key, column, row, u, v), b = lattice_slope(key, column + 1, row, u - 1.0, v);
    double c = lattice_slope(key, column, row + 1, u, v - 1.0);
    double d = lattice_slope(key, column + 1, row + 1, u - 1.0, v - 1.0);
    double s = u * u * u * (u * (6.0 * u - 15.0) + 10.0), t = v * v * v * (v * (6.0 * v - 15.0) + 10.0);
    double south = a + s * (b - a), north = c + s * (d - c);
    return south + t * (north - south);
}

/* Add amplitude · value noise to a row of points, `step` mesh units apart from (x, y) on; bits below 31. */
HOST void value_noise_row(
    uint64_t key, int64_t x, int64_t step, int64_t y, int64_t bits, double amplitude, int64_t columns,
    double row[restrict columns]);
