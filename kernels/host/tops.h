/* Kernels of DEM patches: which greater patches cover them, and which nodes of a raster they cover.
 *
 * Rocca, Panozzo & Puppo, "Patchwork terrains" (2012), algorithm 1 (`cutter`): from a kernel's rectangles
 * those of greater patches are cut one after another, by error, until nothing is left. What is left are
 * convex pieces; slivers of a millionth of the growth are dropped. Corners are counter-clockwise.
 */
#pragma once

#include "host.h"

/* Compute the tops of the patches which[begin ... end - 1]: the error of the patch with which greater ones
 * cover them, infinite if they do not; and which are of a finest level that no more accurate grid covers. */
HOST void compute_tops(
    int64_t asked, int64_t patches, int64_t rectangles, int64_t classes, int64_t cells, int64_t listed,
    const int64_t which[restrict asked],
    const int64_t rank[restrict patches], /* by area */
    const double error[restrict patches], /* m */
    const bool finest[restrict patches], const int32_t grid[restrict patches],
    const double boxes[restrict patches][4], /* west, south, east, north, m */
    const double growth[restrict patches], /* by which a kernel reaches farther, m */
    const int64_t first[restrict patches + 1], /* rectangle of each */
    const double corners[restrict rectangles][4][2], /* m */
    const double places[restrict classes][3], /* of an index of boxes: west, south, side 2^k of cells, m */
    const int64_t shapes[restrict classes][3], /* cells eastward, northward, and the first one's number */
    const int64_t starts[restrict cells], /* the last one is the end */
    const int64_t items[restrict listed], int64_t begin, int64_t end,
    double top[restrict asked], /* m */
    bool is_best[restrict asked],
    int64_t seen[restrict patches], int64_t near[restrict patches], /* scratch from here on */
    double heap[restrict 2 * patches], double other_heap[restrict 2 * patches],
    double pieces[restrict 2][512][20][2], int64_t sizes[restrict 2][512]);

/* Mark the nodes of a raster within the rectangles of kernels, grown. */
HOST void mark_kernels(
    int64_t patches, int64_t rectangles, int64_t rows, int64_t columns,
    const double boxes[restrict patches][4], /* m */
    const double grow[restrict patches], /* m */
    const int64_t first[restrict patches + 1],
    const double corners[restrict rectangles][4][2], /* m */
    double west, double south, double spacing, /* m */
    bool inside[restrict rows][columns]);
