/* Bends of rivers: points whose bank is beside a point further down. */
#pragma once

#include "host.h"

/* Find points, the position further down that a bank of theirs is nearest to, and how far from it; returns
 * how many. Only positions within a reach along the river are compared, four between two points. */
HOST int64_t nearest_below(
    int64_t points, int64_t sides, int64_t most,
    const double line[restrict points][2], /* m */
    const double arc[restrict points], /* m */
    const double width[restrict points], /* m */
    const double normals[restrict 2][points][2], /* before and after each point */
    const double banks[restrict sides], /* widths beside the river */
    double reach, /* widths */
    int64_t upper[restrict most], /* 2 * sides * points */
    double lower[restrict most], /* fractional points */
    double off[restrict most], /* half widths */
    double scratch[restrict 4 * points][2]); /* positions */
