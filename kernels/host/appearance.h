/* Texels of what vectors paint on the terrain. */
#pragma once

#include "host.h"

/* Multiply the three channels of texels by their share, the fourth one: round(c s / 255), 0 ... 255. */
HOST void premultiply(
    int64_t texels, const uint8_t texel[restrict texels][4], uint8_t result[restrict texels][4]);
