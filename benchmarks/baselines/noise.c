// Simplex fBm as a plain loop in C: the same lattice, hash and gradients as kernels/noise.clh, a row at a time and in
// each row an octave at a time, so that compilers can run the inner loop in vectors.
#include <stdint.h>

#define UNSKEW 0.21138669673055244f
#define SIMPLEX_SCALE 3.259629011154175e-08f
#define STRIDE_U 0x9E3779B1u
#define STRIDE_V 0x85EBCA77u

static inline uint32_t scrambled(uint32_t h)
{
    h ^= h >> 15;
    h *= 0x735A2D97u;
    return h ^ h >> 15;
}

static inline float corner(uint32_t h, float dx, float dy)
{
    float fade = 0.5f - (dx * dx + dy * dy);
    fade = fade > 0.0f ? fade : 0.0f;
    fade *= fade;
    return fade * fade * ((float)(int32_t)h * dx + (float)(int32_t)(h << 16) * dy);
}

// Rows first <= row < last of a grid of side * side vertices.
//   corners     4 an octave: fractions along u and v in steps, hash of the cell, bits of a cell in steps
//   turned      1 where an octave's lattice is turned by 90 degrees
void fbm_rows(int first, int last, int side, int octaves, const uint32_t *corners, const uint32_t *turned,
              const float *amplitude, float *restrict sum)
{
    for (int row = first; row < last; ++row) {
        float *restrict out = sum + (int64_t)row * side;
        for (int column = 0; column < side; ++column) out[column] = 0.0f;
        for (int i = 0; i < octaves; ++i) {
            const uint32_t *c = corners + 4 * i;
            const int bits = c[3];
            const int32_t across_u = turned[i] ? -375 : 1399, across_v = turned[i] ? -1399 : 375;
            const int32_t start_u = (int32_t)c[0] + row * (turned[i] ? 1399 : 375);
            const int32_t start_v = (int32_t)c[1] + row * (turned[i] ? 375 : 1399);
            const uint32_t hash = c[2];
            const float weight = amplitude[i] * SIMPLEX_SCALE;
            for (int column = 0; column < side; ++column) {
                const int32_t u = start_u + across_u * column, v = start_v + across_v * column;
                const uint32_t h = hash + (uint32_t)(u >> bits) * STRIDE_U + (uint32_t)(v >> bits) * STRIDE_V;
                const float fu = (float)(int32_t)((uint32_t)u << (32 - bits) >> 8) * 0x1p-24f;
                const float fv = (float)(int32_t)((uint32_t)v << (32 - bits) >> 8) * 0x1p-24f;
                const int lower = fu > fv;
                const float unskewed = (fu + fv) * UNSKEW;
                const float x = fu - unskewed, y = fv - unskewed;
                out[column] += weight
                    * (corner(scrambled(h), x, y)
                       + corner(scrambled(h + (lower ? STRIDE_U : STRIDE_V)), x + (lower ? UNSKEW - 1.0f : UNSKEW),
                                y + (lower ? UNSKEW : UNSKEW - 1.0f))
                       + corner(scrambled(h + (STRIDE_U + STRIDE_V)), x + (2.0f * UNSKEW - 1.0f),
                                y + (2.0f * UNSKEW - 1.0f)));
            }
        }
    }
}
