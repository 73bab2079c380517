/* Landforms and summits of measured heights.
 *
 * Jasiewicz & Stepinski, "Geomorphons - a pattern recognition approach to classification and mapping of
 * landforms" (2013): zenith and nadir horizons of eight directions. Key saddles: cells are joined from the
 * highest down; where two regions meet is the key saddle of the lower summit.
 */
#pragma once

#include "host.h"

/* Find the landform of each cell by how many directions are lower and higher. The horizon's angles are of the
 * system's arctangent: metrics, which no terrain depends on. */
HOST void geomorphons(
    int64_t rows, int64_t columns,
    const double height[restrict rows][columns], /* m */
    double cell, /* m */
    double flatness, /* sum of a direction's angles that counts as level, radians */
    int64_t horizon, /* cells */
    const int8_t table[restrict 9][9], /* codes by numbers of lower and of higher directions */
    int8_t form[restrict rows][columns], double scratch[restrict 2][columns]);

/* Find summits of a least prominence and their key saddles; returns how many. The highest summit has none. */
HOST int64_t key_saddles(
    int64_t cells, int64_t columns,
    const double height[restrict cells], /* m */
    const int64_t descending[restrict cells], /* cells from the highest down */
    double least_prominence, /* m */
    double summit[restrict cells], /* m */
    double saddle[restrict cells], /* m */
    int64_t scratch[restrict 2][cells]);
