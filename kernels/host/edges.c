#include "edges.h"

#include <string.h>

/* The integral of min(x, 1) from 0, 0 below. */
static inline double clamped_integral(double x)
{
    double inside = 0.5 * x * x, beyond = x - 0.5, positive = x < 1.0 ? inside : beyond;
    return x < 0.0 ? 0.0 : positive;
}

void sum_edges(
    int64_t edges, int64_t rows, int64_t columns, const double edge[restrict edges][4],
    const double value[restrict edges][4], int64_t total[restrict rows][columns][4],
    int64_t ahead[restrict rows][columns + 1][4])
{
    memset(ahead, 0, (size_t)(rows * (columns + 1)) * sizeof ahead[0][0]);
    for (int64_t k = 0; k < edges; k++) {
        double x = edge[k][0], y = edge[k][1], east = edge[k][2], north = edge[k][3];
        if (north == 0.0)
            continue;
        double low = least(y, y + north), high = greatest(y, y + north), sign = north > 0.0 ? -1.0 : 1.0;
        int64_t end = bounded_floor(ceil(high), 0, rows);
        for (int64_t row = bounded_floor(low, 0, rows); row < end; row++) {
            double south = greatest(low, (double)row), top = least(high, (double)row + 1.0);
            double start = x + east * (south - y) / north, stop = x + east * (top - y) / north;
            double a = least(start, stop), b = greatest(start, stop), part = sign * (top - south);
            int64_t first = bounded_floor(a, 0, columns), last = bounded_floor(b, -1, columns - 1);
            for (int64_t column = first; column <= last; column++) {
                double until = (double)column + 1.0, share;
                if (b - a > 1e-9)
                    share = (clamped_integral(until - a) - clamped_integral(until - b)) / (b - a);
                else
                    share = least(greatest(until - a, 0.0), 1.0);
                for (int64_t c = 0; c < 4; c++)
                    total[row][column][c] += (int64_t)rint(value[k][c] * part * share);
            }
            for (int64_t c = 0; c < 4; c++)
                ahead[row][greatest_index(last + 1, first)][c] += (int64_t)rint(value[k][c] * part);
        }
    }
    for (int64_t row = 0; row < rows; row++) {
        int64_t sum[4] = {0};
        for (int64_t column = 0; column < columns; column++)
            for (int64_t c = 0; c < 4; c++)
                total[row][column][c] += sum[c] += ahead[row][column][c];
    }
}

int64_t edges_near(
    int64_t blocks, int64_t edges, const int64_t first[restrict blocks + 1],
    const double edge[restrict edges][4], const int64_t block[restrict blocks][4], int64_t reach, double unit,
    int64_t farthest, bool inside[restrict blocks], int64_t count[restrict blocks],
    int32_t ends[restrict edges][4], int32_t row[restrict edges][4])
{
    int64_t total = 0;
    for (int64_t k = 0; k < blocks; k++) {
        int64_t west = block[k][0], south = block[k][1], side = block[k][2] - west, top = block[k][3] - south;
        int64_t before = total;
        for (int64_t e = first[k]; e < first[k + 1]; e++) {
            int64_t x = (int64_t)rint(edge[e][0] / unit) - west, y = (int64_t)rint(edge[e][1] / unit) - south;
            int64_t to_x = (int64_t)rint(edge[e][2] / unit) - west;
            int64_t to_y = (int64_t)rint(edge[e][3] / unit) - south;
            if (y > to_y || (y == to_y && x > to_x)) {
                int64_t from_x = x, from_y = y;
                x = to_x, y = to_y;
                to_x = from_x, to_y = from_y;
            }
            int64_t east = to_x - x, north = to_y - y;
            /* As in area_share of landuse.clh. */
            inside[k] ^= y <= 0 && to_y > 0 && (side - x) * north < -east * y + (east > 0);
            if (greatest_index(x, to_x) < -reach || least_index(x, to_x) > side + reach || to_y < -reach
                || y > top + reach)
                continue;
            int64_t low = y, high = to_y, cut = INT32_MAX;
            if (x > side && to_x > side) {
                high = low;
            } else if (x > side || to_x > side) {
                int64_t across = north * (side - x); /* rows up to the side are across / east, rounded up */
                int64_t up = y - (east > 0 ? floor_divide(-across, east) : floor_divide(across, -east));
                if (x > side)
                    low = greatest_index(low, up);
                else
                    high = least_index(high, up);
                if (up > 0)
                    cut = up;
            }
            int64_t values[4] = {x, y, to_x, to_y};
            for (int64_t c = 0; c < 4; c++)
                ends[total][c] = (int32_t)least_index(greatest_index(values[c], -farthest), farthest);
            row[total][0] = (int32_t)greatest_index(low, -farthest);
            row[total][1] = (int32_t)least_index(high, farthest);
            row[total][2] = (int32_t)cut;
            row[total++][3] = 0;
        }
        count[k] = total - before;
    }
    return total;
}
