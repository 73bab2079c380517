#include "wetness.h"

#include <string.h>

static const double level_slope = 1.0 / 32.0; /* below which ground is level */
static const double spread = 0.5, climb = 12.0; /* of the index, over the spacing of level 0 */
static const double dry = 7.0, soaked = 13.0; /* index that gives 0, and 1 */
enum { SWEEPS = 2 };

/* What is left of the index after a way (m) and a rise (m), if any. */
static inline double left_after(double index, double rise, double way, double finest)
{
    return index - (spread * way + climb * (rise > 0.0 ? rise : 0.0)) / finest;
}

/* Write the index of a row of nodes before it spreads, from their areas and the three rows of heights. */
static void start_row(
    int64_t columns, const double south[restrict columns + 2], const double here[restrict columns + 2],
    const double north[restrict columns + 2], const double area[restrict columns], double spacing,
    double finest, double index[restrict columns + 2])
{
    double own = spacing * spacing - finest * finest, width = finest * spacing, diagonal = sqrt(0.5);
    for (int64_t i = 0; i < columns; i++) {
        double z = here[i + 1], fall = level_slope * spacing;
        fall = greatest(greatest(fall, z - here[i]), z - here[i + 2]);
        fall = greatest(greatest(fall, z - south[i + 1]), z - north[i + 1]);
        fall = greatest(greatest(fall, (z - south[i]) * diagonal), (z - south[i + 2]) * diagonal);
        fall = greatest(greatest(fall, (z - north[i]) * diagonal), (z - north[i + 2]) * diagonal);
        index[i + 1] = greatest(1.0, (area[i] - own) / width) * spacing / fall;
    }
    for (int64_t i = 1; i <= columns; i++) { /* 2^e (1 + m) with 0 <= m < 1, of which the index is e + m */
        int64_t bits, one = INT64_C(0x3FF0000000000000);
        memcpy(&bits, &index[i], sizeof bits);
        double exponent = here[i] == here[i] ? (double)(int32_t)((bits >> 52) - 1022) : NAN, mantissa;
        bits = (bits & INT64_C(0xFFFFFFFFFFFFF)) | one;
        memcpy(&mantissa, &bits, sizeof bits);
        index[i] = exponent + mantissa - 2.0;
    }
}

/* Raise the index of a row of nodes to what the row before leaves to it. */
static void spread_row(
    int64_t columns, const double before[restrict columns + 2], const double here[restrict columns + 2],
    const double given[restrict columns + 2], double index[restrict columns + 2], double spacing,
    double finest)
{
    double slant = spacing * sqrt(2.0);
    for (int64_t i = 0; i < columns; i++) {
        double z = here[i + 1];
        double west = left_after(given[i], z - before[i], slant, finest);
        double east = left_after(given[i + 2], z - before[i + 2], slant, finest);
        double south = left_after(given[i + 1], z - before[i + 1], spacing, finest);
        index[i + 1] = greatest(greatest(greatest(index[i + 1], west), east), south);
    }
}

/* The weighted sum (1 2 1) of nodes of three rows from i on. */
static inline double sum_around(const double *south, const double *here, const double *north, int64_t i)
{
    double sum = south[i] + 2.0 * south[i + 1] + south[i + 2];
    sum = sum + 2.0 * here[i] + 4.0 * here[i + 1] + 2.0 * here[i + 2];
    return sum + north[i] + 2.0 * north[i + 1] + north[i + 2];
}

void wetness(
    int64_t rows, int64_t columns, const double height[restrict rows][columns],
    const double area[restrict rows][columns], double spacing, double finest,
    float wet[restrict rows][columns], double scratch[restrict 2][rows + 2][columns + 2])
{
    /* With a margin of NaN, which no comparison chooses. */
    double(*z)[columns + 2] = scratch[0], (*index)[columns + 2] = scratch[1];
    for (int64_t j = 0; j < rows + 2; j++)
        for (int64_t i = 0; i < columns + 2; i++) {
            bool inside = j > 0 && i > 0 && j <= rows && i <= columns;
            z[j][i] = inside ? height[j - 1][i - 1] : NAN;
            index[j][i] = NAN;
        }
    for (int64_t j = 1; j <= rows; j++)
        start_row(columns, z[j - 1], z[j], z[j + 1], area[j - 1], spacing, finest, index[j]);
    for (int64_t sweep = 0; sweep < 2 * SWEEPS; sweep++) {
        int64_t step = sweep % 2 ? -1 : 1;
        for (int64_t q = 1; q <= rows; q++) {
            int64_t j = step > 0 ? q : rows + 1 - q;
            spread_row(columns, z[j - step], z[j], index[j - step], index[j], spacing, finest);
            double last = NAN; /* the index of the node before */
            for (int64_t p = 1; p <= columns; p++) {
                int64_t i = step > 0 ? p : columns + 1 - p;
                last = left_after(last, z[j][i] - z[j][i - step], spacing, finest);
                last = index[j][i] = greatest(index[j][i], last);
            }
        }
    }
    double(*weight)[columns + 2] = scratch[0]; /* heights are not needed any more */
    for (int64_t j = 0; j < rows + 2; j++)
        for (int64_t i = 0; i < columns + 2; i++) {
            bool inside = index[j][i] == index[j][i];
            weight[j][i] = inside ? 1.0 : 0.0;
            index[j][i] = inside ? index[j][i] : 0.0;
        }
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++) {
            double mean = sum_around(index[j], index[j + 1], index[j + 2], i)
                          / greatest(sum_around(weight[j], weight[j + 1], weight[j + 2], i), 1.0);
            double share = least(greatest((mean - dry) / (soaked - dry), 0.0), 1.0);
            wet[j][i] = weight[j + 1][i + 1] > 0.0 ? (float)share : 0.0f;
        }
}
