#include "uplift.h"
#include "mesh.h"
#include "noise.h"

static const double REACH = 0.9; /* radii beyond its outline that a feature may raise */
static const double NEIGHBOUR = 0.15; /* weight of features of other shapes inside a shape */
static const double LIFT = 0.2, GAIN_CLIP = 1.5;
static const double LEAST_FACTOR = 0.1, MOST_FACTOR = 8.0;

/* Rows and columns within reach of a feature. */
typedef struct {
    int32_t south, north, west, east;
} Box;

static Box box_around(
    double x, double y, double reach, int64_t row, int64_t column, int64_t step, int64_t rows,
    int64_t columns)
{
    double south = floor((y - reach - (double)row) / (double)step);
    double north = floor((y + reach - (double)row) / (double)step);
    double west = floor((x - reach - (double)column) / (double)step);
    double east = floor((x + reach - (double)column) / (double)step);
    return (Box){
        (int32_t)greatest_index((int64_t)south, 0), (int32_t)least_index((int64_t)north + 2, rows),
        (int32_t)greatest_index((int64_t)west, 0), (int32_t)least_index((int64_t)east + 2, columns)};
}

/* Loops over distances become vectors by 32-bit integers, and by selections instead of branches. */
static inline double distance(int32_t row, int32_t column, double x, double y)
{
    double up = (double)row - y, right = (double)column - x;
    return sqrt(up * up + right * right);
}

/* Weight of a feature at a node of a shape. */
static inline double feature_weight(double away, double reach, double radius, int32_t belongs, int32_t region)
{
    double t = 1.0 - away / reach, weight = t * t * t * radius * radius;
    return region >= 0 && region != belongs ? weight * NEIGHBOUR : weight;
}

void uneven_noise(
    int64_t row, int64_t column, uint64_t key, int64_t bits, double amplitude, int64_t rows, int64_t columns,
    double noise[restrict rows][columns])
{
    for (int64_t i = 0; i < rows; i++)
        value_noise_row(key, column * SIDE, SIDE, (row + i) * SIDE, bits, amplitude, columns, noise[i]);
}

void feature_nearness(
    int64_t features, const double x[restrict features], const double y[restrict features],
    const double radius[restrict features], double zone, int64_t rows, int64_t columns,
    double near[restrict rows][columns])
{
    for (int64_t k = 0; k < features; k++) {
        const double east = x[k], north = y[k], own = radius[k], reach = own * (1.0 + zone) + 2.0;
        Box box = box_around(east, north, reach, 0, 0, 1, rows, columns);
        for (int32_t i = box.south; i < box.north; i++)
            for (int32_t j = box.west; j < box.east; j++) {
                double away = distance(i, j, east, north), deep = 1.0 - away / own;
                near[i][j] = away < reach && deep > near[i][j] ? deep : near[i][j];
            }
    }
}

void features_at(
    int64_t features, int64_t values, const double x[restrict features], const double y[restrict features],
    const double radius[restrict features], const double value[restrict features][values],
    const int64_t belongs[restrict features], int64_t rows, int64_t columns,
    const int32_t region[restrict rows][columns], double outside, double depth[restrict rows][columns],
    int64_t owner[restrict rows][columns], double means[restrict rows][columns][values],
    double scratch[restrict 4][rows][columns])
{
    double (*restrict deepest)[columns] = scratch[0], (*restrict weights)[columns] = scratch[1];
    double (*restrict radii)[columns] = scratch[2], *restrict weight = scratch[3][0];
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++) {
            depth[i][j] = deepest[i][j] = outside;
            owner[i][j] = -1;
        }
    for (int64_t k = 0; k < features; k++) {
        const double east = x[k], north = y[k], own = radius[k], reach = own * (1.0 + REACH) + 2.0;
        const int32_t shape = (int32_t)belongs[k];
        Box box = box_around(east, north, reach, 0, 0, 1, rows, columns);
        for (int32_t i = box.south; i < box.north; i++) {
            for (int32_t j = box.west; j < box.east; j++) {
                double away = distance(i, j, east, north), inside = own - away;
                bool is_near = away < reach, is_deepest = is_near && inside / own > deepest[i][j];
                weight[j] = is_near ? feature_weight(away, reach, own, shape, region[i][j]) : 0.0;
                weights[i][j] += weight[j];
                radii[i][j] += weight[j] * own;
                double deep = depth[i][j] > outside ? greatest(depth[i][j], inside) : inside;
                depth[i][j] = is_near ? deep : depth[i][j];
                deepest[i][j] = is_deepest ? inside / own : deepest[i][j];
                owner[i][j] = is_deepest ? k : owner[i][j];
            }
            for (int32_t j = box.west; j < box.east; j++)
                for (int32_t m = 0; m < values && weight[j] > 0.0; m++)
                    means[i][j][m] += weight[j] * value[k][m];
        }
    }
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++) {
            if (!(weights[i][j] > 0.0))
                continue;
            depth[i][j] = greatest(depth[i][j] / (radii[i][j] / weights[i][j]), -1.0);
            for (int64_t m = 0; m < values; m++)
                means[i][j][m] /= weights[i][j];
            if (deepest[i][j] <= LIFT)
                owner[i][j] = -1;
        }
}

void mean_factors(
    int64_t features, const double x[restrict features], const double y[restrict features],
    const double radius[restrict features], const double factor[restrict features],
    const int64_t belongs[restrict features], int64_t fine_rows, int64_t fine_columns,
    const int32_t region[restrict fine_rows][fine_columns], int64_t row, int64_t column, int64_t step,
    int64_t rows, int64_t columns, double mean[restrict rows][columns],
    double scratch[restrict rows][columns])
{
    for (int64_t k = 0; k < features; k++) {
        const double east = x[k], north = y[k], own = radius[k], reach = own * (1.0 + REACH) + 2.0;
        const double scale = factor[k];
        const int32_t shape = (int32_t)belongs[k];
        Box box = box_around(east, north, reach, row, column, step, rows, columns);
        for (int32_t i = box.south; i < box.north; i++) {
            const int32_t q = (int32_t)(row + i * step);
            for (int32_t j = box.west; j < box.east; j++) {
                int32_t p = (int32_t)column + j * (int32_t)step;
                double away = distance(q, p, east, north);
                double weight = feature_weight(away, reach, own, shape, region[q][p]);
                weight = away < reach ? weight : 0.0;
                scratch[i][j] += weight;
                mean[i][j] += weight * scale;
            }
        }
    }
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++)
            mean[i][j] = scratch[i][j] > 0.0 ? mean[i][j] / scratch[i][j] : 1.0;
}

/* What quadratic B-splines read at a node. */
static inline double as_read(
    int64_t rows, int64_t columns, const double values[restrict rows][columns], int64_t i, int64_t j)
{
    const double *south = values[greatest_index(i - 1, 0)], *north = values[least_index(i + 1, rows - 1)];
    double found[3];
    for (int64_t k = 0; k < 3; k++) {
        int64_t at = least_index(greatest_index(j + k - 1, 0), columns - 1);
        found[k] = 0.75 * values[i][at] + 0.125 * (south[at] + north[at]);
    }
    return 0.75 * found[1] + 0.125 * (found[0] + found[2]);
}

void adjust_factors(
    int64_t rows, int64_t columns, const double effect[restrict rows][columns],
    const double below[restrict rows][columns], int64_t fine_rows, int64_t fine_columns,
    const double target[restrict fine_rows][fine_columns],
    const int64_t owner[restrict fine_rows][fine_columns], int64_t features, int64_t groups,
    const int64_t group[restrict features], double least_rise, int64_t row, int64_t column, int64_t step,
    double share, double factor[restrict features], double scratch[restrict groups])
{
    for (int64_t k = 0; k < groups; k++)
        scratch[k] = 0.0; /* effect over the rise that is aimed at */
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++) {
            int64_t q = row + i * step, p = column + j * step, k = owner[q][p];
            double rise = target[q][p] - below[i][j];
            if (k >= 0 && rise > least_rise)
                scratch[group[k]] = greatest(
                    scratch[group[k]], as_read(rows, columns, effect, i, j) / rise);
        }
    for (int64_t k = 0; k < features; k++) {
        double reached = scratch[group[k]];
        if (!(reached > 0.0))
            continue;
        double change = least(greatest(1.0 / reached, 1.0 / GAIN_CLIP), GAIN_CLIP);
        change = 1.0 + share * (change - 1.0);
        factor[k] = least(greatest(factor[k] * change, LEAST_FACTOR), MOST_FACTOR);
    }
}
