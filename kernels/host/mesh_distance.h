/* Distance of a triangle mesh from the grid that it was made of, at each of the grid's vertices.
 *
 * A triangle's plane is z = z_a + s_x (column - x_a) + s_y (row - y_a). Its rows are cut in integers, so that
 * no vertex on an edge is left out.
 */
#pragma once

#include "host.h"

/* Return the largest vertical distance (m) of a mesh from heights; vertices of the grid in a triangle, its
 * edges included, are set to false in `missed`. */
HOST double largest_distance(
    int64_t triangles, int64_t vertices, int64_t rows, int64_t columns,
    const uint32_t triangle[restrict triangles][3], const int32_t column[restrict vertices],
    const int32_t row[restrict vertices],
    const double corner[restrict vertices], /* heights of the mesh, m */
    const double height[restrict rows][columns], /* m */
    bool missed[restrict rows][columns]);
