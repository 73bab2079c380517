/* Flow routing on measured heights: what water does on a window, whatever made the heights.
 *
 * Barnes, Lehman & Mulla, "Priority-flood: an optimal depression-filling and watershed-labeling algorithm for
 * digital elevation models" (2014), algorithm 2 with a small rise across fills; steepest descent (D8) after
 * O'Callaghan & Mark (1984); stream order after Strahler (1957). Cells are row * columns + column.
 */
#pragma once

#include "host.h"

/* Fill depressions from the border inward: filled = max(height, level of the cell before + rise). */
HOST void fill_depressions(
    int64_t rows, int64_t columns,
    const double height[restrict rows][columns], /* m */
    double rise, /* across a fill, m a cell */
    double filled[restrict rows][columns], /* m */
    int64_t parent[restrict rows * columns], /* cell from which the flood came, -1 at the border */
    double scratch[restrict 2 * rows * columns]); /* a heap */

/* Find the neighbour of steepest descent, (h - h') / distance; where none is lower, back along the flood. */
HOST void steepest_descent(
    int64_t rows, int64_t columns,
    const double filled[restrict rows][columns], /* m */
    const int64_t parent[restrict rows * columns],
    int64_t receiver[restrict rows * columns], /* cell, -1 at the border */
    double step[restrict rows * columns]); /* way to the receiver, cells */

/* Sum drainage areas (cells) and the longest way of water (cells) against the order of flow. */
HOST void accumulate_flow(
    int64_t cells,
    const int64_t order[restrict cells], /* receivers before their donors */
    const int64_t receiver[restrict cells],
    const double step[restrict cells], /* cells */
    double area[restrict cells], double length[restrict cells]);

/* Strahler's order of cells that drain at least an area (cells), 0 elsewhere. */
HOST void stream_orders(
    int64_t cells, const int64_t order[restrict cells], const int64_t receiver[restrict cells],
    const double area[restrict cells],
    double least_area, /* cells */
    int64_t stream[restrict cells],
    int64_t tributaries[restrict cells]); /* scratch: streams of the highest order that join here */

/* Way along the flow over the straight distance, from each start to `reach` (cells) farther; returns how many
 * starts have so long a way. */
HOST int64_t sinuosities(
    int64_t starts, int64_t cells, const int64_t start[restrict starts],
    const int64_t receiver[restrict cells],
    const double step[restrict cells], /* cells */
    int64_t columns,
    double reach, /* cells */
    double found[restrict starts]);
