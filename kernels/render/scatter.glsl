// Points scattered by hashed cells, see render/scatter.py. Pure. Oracle: tests/render/test_ground_cover.py.

const float BAND = 0.3;           // as in render/scatter.py
const uint FIRST_STEP = 3242174889u;  // 2³² over the plastic number …
const uint SECOND_STEP = 2447445414u; // … and over its square: the sequence R2 (Roberts 2018)
const float JITTER = 0.52;            // of the distance between neighbours, hides the lattice

#include "render/hash.glsl"

// 0..1, from the upper 24 bits.
float unit_float(uint h) { return float(h >> 8) / 16777216.0; }

// Hash of a point, by its cell's hash and its rank.
uint point_hash(uint seed, uint rank) { return hash32(seed ^ (rank * 0x9e3779b9u + 0x7f4a7c15u)); }

// Position of a point in its cell, 0..1: the sequence shifted by the cell's hash, jittered less the denser its beginning.
vec2 scatter_position(uint seed, uint rank)
{
    uint h = point_hash(seed, rank);
    uint across = hash32(seed) + (rank + 1u) * FIRST_STEP;
    uint along = hash32(seed + 1u) + (rank + 1u) * SECOND_STEP;
    vec2 jitter = vec2(unit_float(hash32(h + 1u)), unit_float(hash32(h + 2u))) - 0.5;
    return fract(vec2(unit_float(across), unit_float(along)) + jitter * (JITTER / sqrt(float(rank) + 1.0)));
}

// Share of a cell's points used at a distance: all up to `full`, then proportional to the inverse distance.
float density_share(float away, float full) { return full / max(away, full); }

// Opacity 0..1 of a point of a rank in a cell of `capacity` points at a distance: points fade in by `density_share`, all
// fade out near `draw_distance`.
float presence(uint rank, float capacity, float away, float full, float draw_distance)
{
    float share = density_share(away, full);
    float order = (float(rank) + 0.5) / capacity;
    float up = clamp((share * (1.0 + BAND) - order) / (BAND * share), 0.0, 1.0);
    return up * clamp((draw_distance - away) / (0.35 * draw_distance), 0.0, 1.0);
}
