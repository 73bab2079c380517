#include "surface.h"

enum { SIDE = 35, KERNEL = 28, MARGIN = 2, HALF = KERNEL / 2 + MARGIN, WHOLE = 225 };

static const double BEYOND = 1.5; /* samples beyond a grid's rim where its weight is 0 */
static const double CORNER = 36.0 * WHOLE; /* masks are at least 1 over it, of 1, at samples beside voids */

/* A value and its derivatives along two axes. */
typedef struct {
    double value, along, across;
} Gradient;

/* A weight and its derivative. */
typedef struct {
    double weight, slope;
} Fade;

/* Weights of a cubic B-spline's four coefficients, times 6, and their derivatives, times 2. */
typedef struct {
    double weight[4], slope[4];
} Taps;

/* Map metres x, y from the centre to steps, with derivatives by x and y. */
static inline Gradient steps(const double m[6], double x, double y)
{
    double value = m[0] + m[1] * x + m[2] * y + (m[3] * x + m[4] * y) * x + m[5] * y * y;
    return (Gradient){value, m[1] + 2.0 * m[3] * x + m[4] * y, m[2] + m[4] * x + 2.0 * m[5] * y};
}

/* A step from 0 at 0 to 1 at 1, C2: t^3 (10 - 15 t + 6 t^2). */
static inline double smooth(double t)
{
    t = least(greatest(t, 0.0), 1.0);
    return t * t * t * (10.0 + t * (6.0 * t - 15.0));
}

/* 1 between the sides of a grid, C2 down to 0 beyond them. */
static inline Fade inside(double u, double low, double high, double scale)
{
    bool is_low = u - low < high - u;
    double distance = is_low ? u - low : high - u, sign = is_low ? scale : -scale;
    double t = least(greatest(BEYOND + scale * distance, 0.0), 1.0);
    return (Fade){smooth(t), sign * 30.0 * t * t * (1.0 - t) * (1.0 - t)};
}

/* 1 in the middle, C2 down to 0 over some steps to the border of the patch. */
static inline Fade faded(double u, double width)
{
    double t = least((HALF - fabs(u)) / width, 1.0);
    double slope = 30.0 * t * t * (1.0 - t) * (1.0 - t) / width;
    return (Fade){smooth(t), u > 0.0 ? -slope : slope};
}

static inline Taps taps(double t)
{
    double s = 1.0 - t, t2 = t * t, s2 = s * s;
    return (Taps){
        {s2 * s, 4.0 + t2 * (3.0 * t - 6.0), 4.0 + s2 * (3.0 * s - 6.0), t2 * t},
        {-s2, t * (3.0 * t - 4.0), s * (4.0 - 3.0 * s), t2},
    };
}

/* A spline's value and derivatives along columns and rows, by its 4 x 4 coefficients. */
static inline Gradient spline_at(double c[4][4], const Taps *u, const Taps *v)
{
    Gradient sum = {0.0, 0.0, 0.0};
    for (int r = 0; r < 4; r++) {
        double line = u->weight[0] * c[r][0] + u->weight[1] * c[r][1] + u->weight[2] * c[r][2]
            + u->weight[3] * c[r][3];
        sum.value += v->weight[r] * line;
        sum.across += v->slope[r] * line;
        sum.along += v->weight[r] * (u->slope[0] * c[r][0] + u->slope[1] * c[r][1] + u->slope[2] * c[r][2]
            + u->slope[3] * c[r][3]);
    }
    return (Gradient){sum.value / 36.0, sum.along / 12.0, sum.across / 12.0};
}

static inline Gradient height_at(
    const float table[SIDE][SIDE], int64_t i, int64_t j, const Taps *u, const Taps *v)
{
    double c[4][4];
    for (int r = 0; r < 4; r++)
        for (int k = 0; k < 4; k++)
            c[r][k] = (double)table[i + r][j + k];
    return spline_at(c, u, v);
}

static inline Gradient mask_at(
    const uint8_t table[SIDE][SIDE], int64_t i, int64_t j, const Taps *u, const Taps *v)
{
    double c[4][4];
    for (int r = 0; r < 4; r++)
        for (int k = 0; k < 4; k++)
            c[r][k] = (double)table[i + r][j + k];
    Gradient found = spline_at(c, u, v);
    return (Gradient){found.value / WHOLE, found.along / WHOLE, found.across / WHOLE};
}

void evaluate_surface(
    int64_t points, int64_t patches, int64_t masked, int64_t classes, int64_t cells, int64_t listed,
    int64_t grids, int64_t quantities, const double x[restrict points], const double y[restrict points],
    const double centre[restrict patches][2], const double to_steps[restrict patches][2][6],
    const double density[restrict patches], const double base[restrict patches],
    const int32_t grid[restrict patches], const float coefficients[restrict patches][35][35],
    const int64_t mask_of[restrict patches], const uint8_t masks[restrict masked][35][35],
    const double rims[restrict masked][5], const double places[restrict classes][3],
    const int64_t shapes[restrict classes][3], const int64_t starts[restrict cells],
    const int64_t items[restrict listed], const double values[restrict grids][quantities],
    double height[restrict points], double east[restrict points], double north[restrict points],
    double data[restrict points], double count[restrict points], double means[restrict quantities][points],
    int64_t begin, int64_t end)
{
    for (int64_t n = begin; n < end; n++) {
        double total = 0.0, total_x = 0.0, total_y = 0.0, sum_h = 0.0, sum_x = 0.0, sum_y = 0.0;
        double missing = 1.0;
        int64_t weighted = 0;
        for (int64_t m = 0; m < quantities; m++)
            means[m][n] = 0.0;
        for (int64_t c = 0; c < classes; c++) {
            double column = floor((x[n] - places[c][0]) / places[c][2]);
            double row = floor((y[n] - places[c][1]) / places[c][2]);
            if (!(0.0 <= column && column < shapes[c][0] && 0.0 <= row && row < shapes[c][1]))
                continue;
            int64_t key = shapes[c][2] + (int64_t)row * shapes[c][0] + (int64_t)column;
            for (int64_t k = starts[key]; k < starts[key + 1]; k++) {
                int64_t p = items[k];
                double dx = x[n] - centre[p][0], dy = y[n] - centre[p][1];
                Gradient u = steps(to_steps[p][0], dx, dy), v = steps(to_steps[p][1], dx, dy);
                if (!(fabs(u.value) < HALF && fabs(v.value) < HALF))
                    continue;
                int64_t i = (int64_t)(v.value + HALF), j = (int64_t)(u.value + HALF);
                Taps along = taps(u.value + HALF - j), across = taps(v.value + HALF - i);
                Fade a = faded(u.value, 2.0 * MARGIN), b = faded(v.value, 2.0 * MARGIN);
                double weight = a.weight * b.weight;
                double weight_u = a.slope * b.weight, weight_v = a.weight * b.slope, known = 1.0;
                if (mask_of[p] >= 0) {
                    const double *rim = rims[mask_of[p]];
                    a = inside(u.value, rim[0], rim[1], rim[4]);
                    b = inside(v.value, rim[2], rim[3], rim[4]);
                    if (a.weight * b.weight == 0.0)
                        continue;
                    Gradient mask = mask_at(masks[mask_of[p]], i, j, &along, &across);
                    known = a.weight * b.weight * smooth(CORNER * mask.value);
                    double part = mask.value * a.weight * b.weight;
                    double part_u = mask.along * a.weight * b.weight + mask.value * a.slope * b.weight;
                    double part_v = mask.across * a.weight * b.weight + mask.value * a.weight * b.slope;
                    weight_u = weight_u * part + weight * part_u;
                    weight_v = weight_v * part + weight * part_v;
                    weight *= part;
                    if (weight == 0.0)
                        continue;
                }
                Gradient h = height_at(coefficients[p], i, j, &along, &across);
                double level = h.value + base[p];
                weight *= density[p];
                double weight_x = density[p] * (weight_u * u.along + weight_v * v.along);
                double weight_y = density[p] * (weight_u * u.across + weight_v * v.across);
                missing *= 1.0 - known * faded(u.value, 1.0).weight * faded(v.value, 1.0).weight;
                weighted++;
                total += weight;
                for (int64_t m = 0; m < quantities; m++)
                    means[m][n] += weight * values[grid[p]][m];
                total_x += weight_x;
                total_y += weight_y;
                sum_h += weight * level;
                sum_x += weight_x * level + weight * (h.along * u.along + h.across * v.along);
                sum_y += weight_y * level + weight * (h.along * u.across + h.across * v.across);
            }
        }
        bool is_known = total > 0.0;
        double mean = sum_h / total;
        height[n] = is_known ? mean : NAN;
        east[n] = is_known ? (sum_x - mean * total_x) / total : NAN;
        north[n] = is_known ? (sum_y - mean * total_y) / total : NAN;
        data[n] = is_known ? least(1.0 - missing, 1.0) : 0.0;
        count[n] = (double)weighted;
        for (int64_t m = 0; m < quantities && is_known; m++)
            means[m][n] /= total;
    }
}

void measure_patches(
    int64_t deep, int64_t wide, int64_t rows, int64_t columns, int64_t scale, int64_t down, int64_t across,
    const float spline[restrict deep][wide], int64_t low, const float samples[restrict rows][columns],
    int64_t start, double base, const double w0[restrict scale], const double w1[restrict scale],
    const double w2[restrict scale], const double w3[restrict scale], int64_t first, int64_t last,
    double error[restrict down][across])
{
    const int64_t size = KERNEL + 2 * MARGIN;
    double line[SIDE];
    for (int64_t a = first; a < last; a++) {
        int64_t north = (KERNEL * a - MARGIN) * scale;
        int64_t begin = greatest_index(north, start), end = least_index(north + size * scale, start + rows);
        for (int64_t b = 0; b < across; b++) {
            int64_t west = (KERNEL * b - MARGIN) * scale;
            double most = error[a][b];
            for (int64_t r = begin; r < end; r++) {
                int64_t i = r / scale + MARGIN - low, p = r % scale;
                for (int64_t j = 0; j < SIDE; j++) {
                    int64_t c = KERNEL * b + j;
                    line[j] = w0[p] * spline[i][c] + w1[p] * spline[i + 1][c]
                        + w2[p] * spline[i + 2][c] + w3[p] * spline[i + 3][c];
                }
                for (int64_t k = 0; k < size; k++) {
                    int64_t at = west + k * scale;
                    for (int64_t q = greatest_index(-at, 0); q < least_index(scale, columns - at); q++) {
                        double value = w0[q] * line[k] + w1[q] * line[k + 1]
                            + w2[q] * line[k + 2] + w3[q] * line[k + 3];
                        /* NaN, of a void, is not more. */
                        most = greatest(most, fabs(value + base - samples[r - start][at + q]));
                    }
                }
            }
            error[a][b] = most;
        }
    }
}
