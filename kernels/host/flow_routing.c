#include "flow_routing.h"

void fill_depressions(
    int64_t rows, int64_t columns, const double height[restrict rows][columns], double rise,
    double filled[restrict rows][columns], int64_t parent[restrict rows * columns],
    double scratch[restrict 2 * rows * columns])
{
    HeapEntry *heap = (HeapEntry *)scratch;
    int64_t count = 0;
    const int64_t border = -1, unknown = -2;
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++) {
            bool outer = i == 0 || j == 0 || i == rows - 1 || j == columns - 1;
            filled[i][j] = height[i][j];
            parent[i * columns + j] = outer ? border : unknown;
            if (outer)
                heap_push(heap, &count, height[i][j], i * columns + j);
        }
    while (count > 0) {
        HeapEntry lowest = heap_pop(heap, &count);
        int64_t i = lowest.index / columns, j = lowest.index % columns;
        for (int64_t p = greatest_index(i - 1, 0); p < least_index(i + 2, rows); p++)
            for (int64_t q = greatest_index(j - 1, 0); q < least_index(j + 2, columns); q++) {
                if (parent[p * columns + q] != unknown)
                    continue;
                parent[p * columns + q] = lowest.index;
                filled[p][q] = greatest(height[p][q], lowest.level + rise);
                heap_push(heap, &count, filled[p][q], p * columns + q);
            }
    }
}

void steepest_descent(
    int64_t rows, int64_t columns, const double filled[restrict rows][columns],
    const int64_t parent[restrict rows * columns], int64_t receiver[restrict rows * columns],
    double step[restrict rows * columns])
{
    for (int64_t cell = 0; cell < rows * columns; cell++) {
        receiver[cell] = -1;
        step[cell] = 0.0;
    }
    for (int64_t i = 1; i < rows - 1; i++)
        for (int64_t j = 1; j < columns - 1; j++) {
            int64_t cell = i * columns + j;
            double steepest = 0.0;
            for (int64_t a = -1; a < 2; a++)
                for (int64_t b = -1; b < 2; b++) {
                    if (a == 0 && b == 0)
                        continue;
                    double way = sqrt((double)(a * a + b * b));
                    double slope = (filled[i][j] - filled[i + a][j + b]) / way;
                    if (slope > steepest) {
                        steepest = slope;
                        receiver[cell] = cell + a * columns + b;
                        step[cell] = way;
                    }
                }
            if (receiver[cell] < 0) {
                int64_t back = parent[cell], a = back / columns - i, b = back % columns - j;
                receiver[cell] = back;
                step[cell] = sqrt((double)(a * a + b * b));
            }
        }
}

void accumulate_flow(
    int64_t cells, const int64_t order[restrict cells], const int64_t receiver[restrict cells],
    const double step[restrict cells], double area[restrict cells], double length[restrict cells])
{
    for (int64_t k = 0; k < cells; k++) {
        area[k] = 1.0;
        length[k] = 0.0;
    }
    for (int64_t k = cells - 1; k >= 0; k--) {
        int64_t cell = order[k], to = receiver[cell];
        if (to >= 0) {
            area[to] += area[cell];
            length[to] = greatest(length[to], length[cell] + step[cell]);
        }
    }
}

void stream_orders(
    int64_t cells, const int64_t order[restrict cells], const int64_t receiver[restrict cells],
    const double area[restrict cells], double least_area, int64_t stream[restrict cells],
    int64_t tributaries[restrict cells])
{
    for (int64_t k = 0; k < cells; k++)
        stream[k] = tributaries[k] = 0;
    for (int64_t k = cells - 1; k >= 0; k--) {
        int64_t cell = order[k], to = receiver[cell];
        if (area[cell] < least_area)
            continue;
        if (stream[cell] == 0)
            stream[cell] = 1;
        else if (tributaries[cell] >= 2)
            stream[cell] += 1;
        if (to < 0)
            continue;
        if (stream[cell] > stream[to]) {
            stream[to] = stream[cell];
            tributaries[to] = 1;
        } else if (stream[cell] == stream[to]) {
            tributaries[to] += 1;
        }
    }
}

int64_t sinuosities(
    int64_t starts, int64_t cells, const int64_t start[restrict starts],
    const int64_t receiver[restrict cells], const double step[restrict cells], int64_t columns, double reach,
    double found[restrict starts])
{
    int64_t count = 0;
    for (int64_t k = 0; k < starts; k++) {
        int64_t cell = start[k];
        double way = 0.0;
        while (receiver[cell] >= 0 && way < reach) {
            way += step[cell];
            cell = receiver[cell];
        }
        double rows = (double)(cell / columns - start[k] / columns);
        double straight = hypot(rows, (double)(cell % columns - start[k] % columns));
        if (way >= reach && straight > 1.0)
            found[count++] = way / straight;
    }
    return count;
}
