#include "river_bends.h"

int64_t nearest_below(
    int64_t points, int64_t sides, int64_t most, const double line[restrict points][2],
    const double arc[restrict points], const double width[restrict points],
    const double normals[restrict 2][points][2], const double banks[restrict sides], double reach,
    int64_t upper[restrict most], double lower[restrict most], double off[restrict most],
    double scratch[restrict 4 * points][2])
{
    int64_t count = 0, first = 0, last = 0;
    for (int64_t f = 0; f < 4 * points; f++) {
        int64_t i = f / 4, j = least_index(i + 1, points - 1);
        for (int k = 0; k < 2; k++)
            scratch[f][k] = line[i][k] + 0.25 * (double)(f % 4) * (line[j][k] - line[i][k]);
    }
    for (int64_t p = 0; p < points; p++) {
        while (arc[p] - arc[first] > reach * width[p])
            first++;
        while (last < points - 1 && arc[last + 1] - arc[p] < reach * width[p])
            last++;
        for (int64_t side = 0; side < 2 * sides; side++) {
            double away = banks[side / 2] * width[p];
            double x = line[p][0] + away * normals[side % 2][p][0];
            double y = line[p][1] + away * normals[side % 2][p][1];
            double nearest_square = INFINITY;
            int64_t nearest = 0;
            for (int64_t f = 4 * first; f <= 4 * last; f++) {
                double dx = scratch[f][0] - x, dy = scratch[f][1] - y;
                if (dx * dx + dy * dy < nearest_square) {
                    nearest_square = dx * dx + dy * dy;
                    nearest = f;
                }
            }
            double position = least(0.25 * (double)(nearest + 1), (double)points - 1.0);
            if (position <= (double)p + 0.25 || count == most)
                continue;
            int64_t i = nearest / 4, j = least_index(i + 1, points - 1);
            double here = width[i] + 0.25 * (double)(nearest % 4) * (width[j] - width[i]);
            upper[count] = p;
            lower[count] = position;
            off[count++] = sqrt(nearest_square) / (0.5 * here);
        }
    }
    return count;
}
