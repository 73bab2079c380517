#include "noise.h"

void value_noise_row(
    uint64_t key, int64_t x, int64_t step, int64_t y, int64_t bits, double amplitude, int64_t columns,
    double row[restrict columns])
{
    int64_t north = y >> bits, cell = INT64_C(1) << bits;
    double scale = 1.0 / (double)cell, v = (double)(y - north * cell) * scale;
    v = v * v * (3.0 - 2.0 * v);
    double a, b = unit(hashed(key, x >> bits, north)), c, d = unit(hashed(key, x >> bits, north + 1));
    int64_t east = x >> bits; /* column of b and d */
    for (int64_t start = 0, stop; start < columns; start = stop) { /* points of one cell at a time */
        int64_t column = (x + start * step) >> bits;
        stop = least_index(((column + 1) * cell - x + step - 1) / step, columns);
        a = column == east ? b : unit(hashed(key, column, north));
        c = column == east ? d : unit(hashed(key, column, north + 1));
        east = column + 1;
        b = unit(hashed(key, east, north));
        d = unit(hashed(key, east, north + 1));
        int32_t first = (int32_t)(x + start * step - column * cell), count = (int32_t)(stop - start);
        double *part = row + start;
        for (int32_t i = 0; i < count; i++) {
            double u = (double)(first + i * (int32_t)step) * scale;
            u = u * u * (3.0 - 2.0 * u);
            double low = a + u * (b - a), high = c + u * (d - c);
            part[i] += amplitude * (2.0 * (low + v * (high - low)) - 1.0);
        }
    }
}
