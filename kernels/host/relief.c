#include "relief.h"
#include "noise.h"

static const double STRETCH = 2.0; /* length of ranges over their width */
static const double DEVIATION = 0.262; /* of the noise of ranges */
/* Ranges beyond the sketch: distances (L) from its square where they begin and are as high as anywhere, their
 * width (L); how much of their height is relief. */
static const double RANGES_FROM = 2.4, RANGES_FULL = 6.5, RANGE_WIDTH = 3.0;
static const double RANGE_RELIEF = 0.65;
enum { SKETCH_SIDE = 256 >> SITE_BITS }; /* L */

/* Noise of joined, elongated shapes, their direction varying over the land; a swing per unit. */
static double range_noise(uint64_t key, double x, double y)
{
    const double across_axis = sqrt(0.75);
    double swerve = 2.0 * gradient_noise(key, 0.11 * x, 0.11 * y), total = 0.0, squares = 0.0;
    for (int64_t k = 0; k < 3; k++) {
        double weight = greatest(0.0, 1.0 - fabs(1.5 * swerve - ((double)k - 1.0)));
        if ((k == 0 && swerve < -2.0 / 3.0) || (k == 2 && swerve > 2.0 / 3.0))
            weight = 1.0;
        if (weight == 0.0)
            continue;
        double along = x, across = y;
        if (k == 0) {
            along = -0.5 * x + across_axis * y;
            across = -across_axis * x - 0.5 * y;
        } else if (k == 2) {
            along = 0.5 * x + across_axis * y;
            across = -across_axis * x + 0.5 * y;
        }
        total += weight * gradient_noise(key + (uint64_t)(101 * (k + 1)), along / STRETCH, across);
        squares += weight * weight;
    }
    return total / sqrt(squares) + 0.35 * gradient_noise(key + 7, 2.1 * x, 2.1 * y);
}

static double smooth(double t)
{
    t = least(greatest(t, 0.0), 1.0);
    return t * t * (3.0 - 2.0 * t);
}

/* Height (m) of ranges beyond the sketch at a point: 0 near its square. */
static double range_at(const UpliftFields *fields, int64_t x, int64_t y)
{
    const double scale = 1.0 / UNIT, half = 0.5 * SKETCH_SIDE;
    double east = greatest(fabs((double)x * scale - half) - half, 0.0);
    double north = greatest(fabs((double)y * scale - half) - half, 0.0);
    double far = (sqrt(east * east + north * north) - RANGES_FROM) / (RANGES_FULL - RANGES_FROM);
    if (far <= 0.0 || fields->range <= 0.0)
        return 0.0;
    double u = (double)x * (scale / RANGE_WIDTH), v = (double)y * (scale / RANGE_WIDTH);
    double above = (range_noise(fields->key + 3000, u, v) - fields->range_threshold) / DEVIATION;
    double height = 0.85 + 0.5 * gradient_noise(fields->key + 15, 0.6 * u, 0.6 * v);
    return smooth(far) * smooth(0.5 + 0.42 * above) * height * fields->range;
}

/* Relief (m) of ground above its valleys at a point, the share of mountains, and the height of ranges. */
static double relief_at(
    const UpliftFields *fields, int64_t column, int64_t row, double *restrict share, double *restrict range)
{
    const uint64_t key = fields->key;
    double x = (double)column, y = (double)row, u = x * fields->ground_scale, v = y * fields->ground_scale;
    double swell = gradient_noise(key + 11, 0.5 * u, 0.5 * v) + 0.5 * gradient_noise(key + 12, u, v);
    swell += 0.9 * gradient_noise(key + 14, x * 0x1p-13, y * 0x1p-13);
    double level = fields->pediments, ground = 0.6 - 0.35 * level + (0.7 + 0.7 * level) * swell;
    ground = fields->ground * ground;
    ground = greatest(ground, 0.12 * fields->ground);
    double square = ground * ground;
    *share = 0.0;
    if (fields->mountain_threshold < 1e8) {
        u = x * fields->mountain_scale;
        v = y * fields->mountain_scale;
        double above = (range_noise(key + 1000, u, v) - fields->mountain_threshold) / DEVIATION;
        *share = smooth(0.5 + 0.42 * above);
        double height = 0.85 + 0.4 * gradient_noise(key + 13, 0.6 * u, 0.6 * v);
        height = *share * fields->mountain * height;
        square += height * height;
    }
    if (fields->hill_threshold < 1e8) {
        u = x * fields->hill_scale;
        v = y * fields->hill_scale;
        double above = (range_noise(key + 2000, u, v) - fields->hill_threshold) / DEVIATION;
        double height = smooth(0.5 + 0.7 * above) * fields->hill;
        square += height * height;
    }
    double beyond = *range = range_at(fields, column, row);
    if (beyond > 0.0) {
        *share = greatest(*share, fields->range_rock * least(beyond / (0.6 * fields->range), 1.0));
        square += RANGE_RELIEF * beyond * RANGE_RELIEF * beyond;
    }
    return sqrt(square);
}

void relief_at_points(
    const UpliftFields *fields, int64_t points, const int64_t point[restrict points][2],
    double relief[restrict points], double share[restrict points], double beyond[restrict points])
{
    for (int64_t k = 0; k < points; k++)
        relief[k] = relief_at(fields, point[k][0], point[k][1], &share[k], &beyond[k]);
}

void interpolated_nodes(
    int64_t bits, int64_t column, int64_t row, int64_t coarse_rows, int64_t coarse_columns,
    const double coarse[restrict coarse_rows][coarse_columns], int64_t rows, int64_t columns,
    double fine[restrict rows][columns])
{
    const int64_t cell = INT64_C(1) << bits;
    const double scale = 1.0 / (double)cell;
    for (int64_t j = 0; j < rows; j++) {
        int64_t q = (row + j) >> bits;
        double v = (double)(row + j - q * cell) * scale;
        const double *south = coarse[q - (row >> bits)], *north = south + coarse_columns;
        for (int64_t i = 0; i < columns; i++) {
            int64_t p = (column + i) >> bits;
            double u = (double)(column + i - p * cell) * scale;
            p -= column >> bits;
            double low = south[p] + u * (south[p + 1] - south[p]);
            double high = north[p] + u * (north[p + 1] - north[p]);
            fine[j][i] = low + v * (high - low);
        }
    }
}

void roughened_uplift(
    const UpliftFields *fields, int64_t level, int64_t column, int64_t row, int64_t rows, int64_t columns,
    const double relief[restrict rows][columns], double uplift[restrict rows][columns],
    double scratch[restrict columns])
{
    const int64_t step = INT64_C(1) * SIDE << level;
    for (int64_t j = 0; j < rows; j++) {
        for (int64_t i = 0; i < columns; i++)
            scratch[i] = 0.0;
        value_noise_row(fields->key + 21, column * step, step, (row + j) * step, 8, 1.0, columns, scratch);
        value_noise_row(fields->key + 22, column * step, step, (row + j) * step, 7, 0.9, columns, scratch);
        for (int64_t i = 0; i < columns; i++) {
            double rough = greatest(1.0 + fields->roughness * scratch[i], 0.15);
            uplift[j][i] = relief[j][i] * fields->per_relief * rough;
        }
    }
}

void mean_ground(
    const MeshParameters *mesh, const UpliftFields *fields, int64_t level, int64_t column, int64_t row,
    int64_t rows, int64_t columns, double height[restrict rows][columns],
    double share[restrict rows][columns])
{
    const int64_t step = INT64_C(1) * SIDE << level;
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++) {
            int64_t x = (column + i) * step, y = (row + j) * step;
            double beyond, relief = relief_at(fields, x, y, &share[j][i], &beyond);
            height[j][i] = base_level(mesh, x, y) + 0.85 * relief + 0.6 * RANGE_VALLEYS * beyond;
        }
}
