/* Culling of tiles by the horizon that the ground before them raises, seen from the eye.
 *
 * The horizon is the greatest tangent of elevation in each of 2,048 bearings. A tile raises it in bearings
 * that lie wholly within the tile, by the bottom of its box; boxes are hidden where their tops are below it.
 */
#pragma once

#include "host.h"

/* Set which of the tested boxes lie below the horizon of the ground that is within their limits. Steps of the
 * horizon are first ... last - 1, also beyond a turn. */
HOST void test_against_horizon(
    int64_t boxes, int64_t tests, int64_t tiles, int64_t raisers,
    const int64_t tested[restrict tests], /* boxes by ascending limit */
    const double limit[restrict boxes], /* m */
    const int64_t first[restrict boxes], const int64_t last[restrict boxes],
    const double most[restrict boxes], /* tangent of the top */
    const int64_t raising[restrict raisers], /* tiles of the ground by ascending distance */
    const double far[restrict tiles], /* m, of their farthest points */
    const int64_t ground_first[restrict tiles], const int64_t ground_last[restrict tiles],
    const double bottom[restrict tiles], /* tangent */
    bool hidden[restrict boxes],
    double horizon[restrict 2048]); /* scratch */
