// The textures of materials, each square, tileable, its rows northward (look/texture_levels.py).
//   TEXTURE_CASES  the function of each layer: case 0: return grass(u, v); …
#include "material_layers.clh"

INLINE REAL4 material_at(int layer, REAL u, REAL v)
{
    switch (layer) {
        TEXTURE_CASES
    default: return colour(R(0), R(0), R(0));
    }
}

// Albedo and height of a texel's middle. Global size: the texture's; `texel` is 1 over it.
__kernel void material_paint(int layer, REAL texel, __global REAL4 *painted)
{
    const int i = (int)get_global_id(0), j = (int)get_global_id(1);
    const int size = (int)get_global_size(0);
    painted[j * size + i] = material_at(layer, (R(i) + R(0.5)) * texel, (R(j) + R(0.5)) * texel);
}

INLINE REAL height_of(__global const REAL4 *painted, int size, int i, int j)
{
    return painted[(j & (size - 1)) * size + (i & (size - 1))].w;
}

// ValueSlope eastward and northward, roughness, and how open a texel is to the sky.
//
// Openness is the mean over eight directions of cos² of the horizon's angle: what a cosine lobe sees past a wall
// that high (Max 1988, with directions in place of the integral).
//   size      texels a side, a power of two
//   bump      height 1 in texture widths
//   low, high roughness of height 0 and 1
__kernel void material_relief(__global const REAL4 *painted, REAL bump, REAL low, REAL high, __global REAL4 *relief)
{
    const int i = (int)get_global_id(0), j = (int)get_global_id(1);
    const int size = (int)get_global_size(0);
    const REAL steep = bump * R(size); // slope where height rises by 1 a texel
    const REAL here = height_of(painted, size, i, j);
    const REAL east = height_of(painted, size, i + 1, j) - height_of(painted, size, i - 1, j);
    const REAL north = height_of(painted, size, i, j + 1) - height_of(painted, size, i, j - 1);
    const int along[8] = {1, 1, 0, -1, -1, -1, 0, 1}, up[8] = {0, 1, 1, 1, 0, -1, -1, -1};
    REAL open = R(0);
    for (int k = 0; k < 8; ++k) {
        const REAL each = (along[k] != 0 && up[k] != 0) ? R(0.70710678) : R(1);
        REAL horizon = R(0);
        for (int step = 1; step <= 32; step *= 2) {
            const REAL over = height_of(painted, size, i + step * along[k], j + step * up[k]) - here;
            horizon = real_max(horizon, over * each * reciprocal(R(step)));
        }
        const REAL slope = horizon * steep;
        open += R(0.125) * reciprocal(R(1) + slope * slope);
    }
    relief[j * size + i] = (REAL4)(R(0.5) * east * steep, R(0.5) * north * steep, mix_real(low, high, here), open);
}
