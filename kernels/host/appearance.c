#include "appearance.h"

void premultiply(int64_t texels, const uint8_t texel[restrict texels][4], uint8_t result[restrict texels][4])
{
    for (int64_t n = 0; n < texels; n++)
        for (int c = 0; c < 4; c++) {
            uint32_t share = c < 3 ? texel[n][3] : 255;
            result[n][c] = (uint8_t)((texel[n][c] * share + 127) / 255);
        }
}
