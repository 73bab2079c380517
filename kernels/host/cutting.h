/* Draped features cut at the sides of triangles: pieces of strokes, the cells that they meet, the cut itself.
 *
 * Sun et al. (2008), sections 3.2 and 3.3. Convex polygons, of at most 16 corners, are clipped to half
 * planes: Sutherland & Hodgman, "Reentrant polygon clipping" (1974). Functions that find any number
 * of things write what there is room for, and return the number.
 */
#pragma once

#include "host.h"

/* Write the pieces of lines, one a segment: all within reach that is nearest to it, divided from its
 * neighbours along the bisectors of their corners. */
HOST void stroke_pieces(
    int64_t points, int64_t lines, int64_t segments,
    const double point[restrict points][2], /* m; none is repeated */
    const int64_t first[restrict lines + 1], /* point of each line */
    const double reach[restrict lines], /* m */
    const int64_t owner[restrict segments], /* line, ascending */
    const int64_t place[restrict segments], /* point of the line where it starts, one after another */
    double corners[restrict segments][16][2], /* m */
    int64_t count[restrict segments], /* corners */
    double frame[restrict segments][4], /* m: origin and direction */
    double length[restrict segments], /* m */
    double along[restrict segments]); /* m, of the line's segments before */

/* Find the cells of a grid that polygons, widened by a border, meet, and the polygons' numbers, ascending. */
HOST int64_t cells_met(
    int64_t polygons, int64_t most, int64_t room,
    const double polygon[restrict polygons][most][2], /* cells */
    const int64_t count[restrict polygons], /* corners */
    const double border[restrict polygons], /* cells */
    int64_t side, /* cells along a side of the grid */
    int64_t found[restrict room], int64_t number[restrict room]);

/* Clip polygons to the triangles that meet their cells: each vertex's triangle, polygon, column and row. */
HOST int64_t cut_polygons(
    int64_t polygons, int64_t pairs, int64_t triangles, int64_t cells, int64_t listed, int64_t room,
    const double polygon[restrict polygons][16][2], /* cells: columns eastward and rows southward */
    const int64_t count[restrict polygons], /* corners */
    const int64_t cell[restrict pairs], /* that a polygon meets, as of cells_met */
    const int64_t owner[restrict pairs], /* that polygon, ascending */
    const double corners[restrict triangles][3][2], /* cells; counter-clockwise from above */
    const int64_t first[restrict cells], /* of each cell into met; the last one is the end */
    const int64_t met[restrict listed], /* triangles */
    int64_t stamp[restrict triangles], /* scratch */
    int64_t triangle[restrict room], int64_t part[restrict room], double column[restrict room],
    double row[restrict room]);
