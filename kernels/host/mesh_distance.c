#include "mesh_distance.h"

double largest_distance(
    int64_t triangles, int64_t vertices, int64_t rows, int64_t columns,
    const uint32_t triangle[restrict triangles][3], const int32_t column[restrict vertices],
    const int32_t row[restrict vertices], const double corner[restrict vertices],
    const double height[restrict rows][columns], bool missed[restrict rows][columns])
{
    double largest = 0.0;
    for (int64_t n = 0; n < triangles; n++) {
        uint32_t a = triangle[n][0], b = triangle[n][1], c = triangle[n][2];
        int64_t x[3] = {column[a], column[b], column[c]}, y[3] = {row[a], row[b], row[c]};
        int64_t ux = x[1] - x[0], uy = y[1] - y[0], vx = x[2] - x[0], vy = y[2] - y[0];
        int64_t area = ux * vy - uy * vx;
        if (area == 0) /* a degenerate triangle: its corners are in its neighbours too */
            continue;
        double uz = corner[b] - corner[a], vz = corner[c] - corner[a];
        double slope_x = (uz * vy - uy * vz) / area, slope_y = (ux * vz - uz * vx) / area;
        int64_t south = greatest_index(greatest_index(y[0], y[1]), y[2]);
        for (int64_t i = least_index(least_index(y[0], y[1]), y[2]); i <= south; i++) {
            int64_t first = greatest_index(greatest_index(x[0], x[1]), x[2]);
            int64_t last = least_index(least_index(x[0], x[1]), x[2]);
            for (int k = 0; k < 3; k++) { /* edges that cross the row, from their northern end */
                int other = k < 2 ? k + 1 : 0, start = y[k] < y[other] ? k : other, end = k + other - start;
                int64_t down = y[end] - y[start], across = x[end] - x[start], below = i - y[start];
                if (down == 0 || below < 0 || below > down)
                    continue;
                first = least_index(first, x[start] - floor_divide(-below * across, down));
                last = greatest_index(last, x[start] + floor_divide(below * across, down));
            }
            for (int64_t j = first; j <= last; j++) {
                double surface = corner[a] + slope_x * (j - x[0]) + slope_y * (i - y[0]);
                largest = greatest(largest, fabs(surface - height[i][j]));
                missed[i][j] = false;
            }
        }
    }
    return largest;
}
