#include "landform_metrics.h"

/* Find the steepest tangents up and down from a row of cells in one direction, infinite where it ends. */
static void find_horizons(
    int64_t rows, int64_t columns, const double height[restrict rows][columns], double cell, int64_t reach,
    int64_t row, int64_t a, int64_t b, double up[restrict columns], double down[restrict columns])
{
    double step = sqrt((double)(a * a + b * b));
    for (int64_t j = 0; j < columns; j++) {
        up[j] = -INFINITY;
        down[j] = INFINITY;
    }
    for (int64_t k = 1; k <= reach && row + k * a >= 0 && row + k * a < rows; k++) {
        const double *here = height[row], *there = height[row + k * a];
        double way = step * cell * (double)k;
        int64_t first = b < 0 ? k : 0, last = b > 0 ? columns - k : columns;
        for (int64_t j = first; j < last; j++) {
            double tangent = (there[j + k * b] - here[j]) / way;
            up[j] = greatest(up[j], tangent);
            down[j] = least(down[j], tangent);
        }
    }
}

void geomorphons(
    int64_t rows, int64_t columns, const double height[restrict rows][columns], double cell, double flatness,
    int64_t horizon, const int8_t table[restrict 9][9], int8_t form[restrict rows][columns],
    double scratch[restrict 2][columns])
{
    double *up = scratch[0], *down = scratch[1];
    for (int64_t i = 0; i < rows; i++) {
        for (int64_t j = 0; j < columns; j++)
            form[i][j] = 0; /* 9 times the lower directions, and the higher ones */
        for (int64_t k = 0; k < 9; k++) {
            int64_t a = k / 3 - 1, b = k % 3 - 1;
            if (a == 0 && b == 0)
                continue;
            int64_t reach = (int64_t)((double)horizon / sqrt((double)(a * a + b * b)));
            find_horizons(rows, columns, height, cell, reach, i, a, b, up, down);
            for (int64_t j = 0; j < columns; j++) {
                if (up[j] == -INFINITY)
                    continue;
                double difference = atan(up[j]) + atan(down[j]);
                form[i][j] += difference > flatness ? 1 : difference < -flatness ? 9 : 0;
            }
        }
        for (int64_t j = 0; j < columns; j++)
            form[i][j] = table[form[i][j] / 9][form[i][j] % 9];
    }
}

static int64_t region_of(int64_t *parent, int64_t cell)
{
    while (parent[cell] != cell)
        cell = parent[cell] = parent[parent[cell]];
    return cell;
}

int64_t key_saddles(
    int64_t cells, int64_t columns, const double height[restrict cells],
    const int64_t descending[restrict cells], double least_prominence,
    double summit[restrict cells], double saddle[restrict cells],
    int64_t scratch[restrict 2][cells])
{
    int64_t *parent = scratch[0], *top = scratch[1], count = 0;
    for (int64_t k = 0; k < cells; k++)
        parent[k] = -1;
    for (int64_t k = 0; k < cells; k++) {
        int64_t cell = descending[k], i = cell / columns, j = cell % columns, rows = cells / columns;
        parent[cell] = top[cell] = cell;
        for (int64_t p = greatest_index(i - 1, 0); p < least_index(i + 2, rows); p++)
            for (int64_t q = greatest_index(j - 1, 0); q < least_index(j + 2, columns); q++) {
                int64_t other = p * columns + q;
                if (parent[other] < 0 || other == cell)
                    continue;
                int64_t higher = region_of(parent, cell), lower = region_of(parent, other);
                if (higher == lower)
                    continue;
                if (height[top[higher]] < height[top[lower]]) {
                    int64_t swapped = higher;
                    higher = lower;
                    lower = swapped;
                }
                if (height[top[lower]] - height[cell] >= least_prominence && top[lower] != cell) {
                    summit[count] = height[top[lower]];
                    saddle[count++] = height[cell];
                }
                parent[lower] = higher;
            }
    }
    return count;
}
