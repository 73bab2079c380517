#include "mesh.h"
#include "noise.h"

static const double JITTER = 0.34; /* of a site, either side, L */
static const double TILT_PERIOD = 256.0; /* from crest to crest of the base level, L */
static const double TILT_ACROSS = 0.6; /* gradient across over gradient along */
static const double SHALLOW = 40.0; /* height (in falls along L) below which troughs are shallow */
/* Bits of the cells and ranges (in slope · cell) of the base level's noise. */
static const int64_t SWAY_BITS[2] = {13, 12};
static const double SWAY_SPAN[2] = {1.4, 0.5};
/* The sketch stands on a swell, so that valleys lead away from it: those that led into the painted region
 * would end at its border. Half the side of its top (L), the width of its slope (L), its height (falls). */
static const double SWELL_HALF = 2.0, SWELL_WIDTH = 2.0, SWELL = 3.5;

/* A wave of slope ±1 with rounded crests and troughs, of period 1. */
static double wave(double t)
{
    t = fabs(2.0 * (t - floor(t)) - 1.0); /* 1 at integers, 0 between them */
    if (t < 0.1)
        t = 5.0 * t * t + 0.05;
    else if (t > 0.9)
        t = 0.95 - 5.0 * (1.0 - t) * (1.0 - t);
    return 0.5 * t;
}

double base_level(const MeshParameters *mesh, int64_t x, int64_t y)
{
    const double scale = 1.0 / UNIT;
    double east = (double)(x - 2048) * scale, north = (double)(y - 2048) * scale;
    double along = east * mesh->east + north * mesh->north;
    double across = north * mesh->east - east * mesh->north;
    double level = wave(along / TILT_PERIOD + mesh->phase) - wave(mesh->phase);
    level += TILT_ACROSS * (wave(across / TILT_PERIOD + mesh->across_phase) - wave(mesh->across_phase));
    level *= TILT_PERIOD;
    for (int64_t k = 0; k < 2; k++) {
        double noise = value_noise(mesh->sway + (uint64_t)SWAY_BITS[k], x, y, SWAY_BITS[k]);
        level += 0.5 * SWAY_SPAN[k] * noise * (double)(INT64_C(1) << SWAY_BITS[k]) * scale / 1.5;
    }
    /* Basins without outlet, in the deepest troughs, are shallow. */
    double above = level - TILT_PERIOD * (1.0 + TILT_ACROSS) * (0.025 - 0.25), s = above / SHALLOW;
    if (s < 0.0)
        level += (0.1 * s - s) * SHALLOW;
    else if (s < 1.0)
        level += (s * (0.1 + s * (1.8 - 0.9 * s)) - s) * SHALLOW;
    double away_x = greatest(fabs(east) - SWELL_HALF, 0.0), away_y = greatest(fabs(north) - SWELL_HALF, 0.0);
    double t = least(sqrt(away_x * away_x + away_y * away_y) / SWELL_WIDTH, 1.0);
    level += SWELL * (1.0 - t * t * (3.0 - 2.0 * t));
    return level * mesh->fall;
}

/* The diagonal of a quad: the shorter one, unless the quad is not convex there. */
static int64_t shorter_diagonal(
    double ax, double ay, double bx, double by, double cx, double cy, double dx, double dy)
{
    if (turn(ax, ay, bx, by, cx, cy) <= 0.0 || turn(ax, ay, cx, cy, dx, dy) <= 0.0)
        return 1;
    if (turn(ax, ay, bx, by, dx, dy) <= 0.0 || turn(bx, by, cx, cy, dx, dy) <= 0.0)
        return 0;
    double first = (cx - ax) * (cx - ax) + (cy - ay) * (cy - ay);
    return first <= (dx - bx) * (dx - bx) + (dy - by) * (dy - by) ? 0 : 1;
}

void lattice_sites(
    const MeshParameters *mesh, int64_t column, int64_t row, int64_t rows, int64_t columns,
    double x[restrict rows + 1][columns + 1], double y[restrict rows + 1][columns + 1],
    int64_t diagonal[restrict rows][columns])
{
    for (int64_t j = 0; j <= rows; j++)
        for (int64_t i = 0; i <= columns; i++) {
            uint64_t bits = hashed(mesh->jitter, column + i, row + j);
            x[j][i] = JITTER * (2.0 * ((double)(int64_t)(bits & 0xFFFFFF) * 0x1p-24) - 1.0);
            y[j][i] = JITTER * (2.0 * ((double)(int64_t)(bits >> 40) * 0x1p-24) - 1.0);
        }
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++)
            diagonal[j][i] = shorter_diagonal(
                x[j][i], y[j][i], 1.0 + x[j][i + 1], y[j][i + 1],
                1.0 + x[j + 1][i + 1], 1.0 + y[j + 1][i + 1], x[j + 1][i], 1.0 + y[j + 1][i]);
}

void lowest_around_sites(
    int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const double height[restrict rows][columns][2], double low[restrict rows + 1][columns + 1])
{
    for (int64_t j = 0; j <= rows; j++)
        for (int64_t i = 0; i <= columns; i++)
            low[j][i] = INFINITY;
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++)
            for (int64_t half = 0; half < 2; half++)
                for (int64_t k = 0; k < 3; k++) {
                    int64_t corner = CORNERS[diagonal[j][i]][half][k];
                    double *site = &low[j + CORNER_Y[corner]][i + CORNER_X[corner]];
                    *site = least(*site, height[j][i][half]);
                }
}

/* The side of a quad between two of its corners. */
static int64_t quad_side(int64_t first, int64_t second)
{
    if (first + second == 1)
        return 0;
    if (first + second == 5)
        return 2;
    if ((first - second) % 2 == 0)
        return 4;
    return first + second == 3 && first != 0 && second != 0 ? 1 : 3;
}

/* The same side seen from the triangle beyond. */
static int64_t opposite(int64_t side) { return side == 4 ? 4 : (side + 2) % 4; }

double edge_inflow(const MeshTable *table, Triangle at, int64_t first, int64_t second)
{
    int64_t side = quad_side(first, second), vertex = vertex_index(table, at);
    if (table->receiver[vertex] == side)
        return 0.5 * (double)table->upstream[vertex];
    vertex = vertex_index(table, neighbour(table, at, side));
    return table->receiver[vertex] == opposite(side) ? 0.5 * (double)table->upstream[vertex] : 0.0;
}

/* How far (L) a point is from a triangle's centroid, both from the lattice point (row, column). */
static double centroid_distance(
    const MeshTable *table, int64_t row, int64_t column, Triangle at, double px, double py)
{
    double x = 0.0, y = 0.0;
    for (int64_t k = 0; k < 3; k++) {
        int64_t corner = triangle_numbers(table, at)[k];
        int64_t site = site_index(table, at.row, at.column, corner);
        x += (double)(at.column + CORNER_X[corner] - column) + table->site_x[site];
        y += (double)(at.row + CORNER_Y[corner] - row) + table->site_y[site];
    }
    x /= 3.0;
    y /= 3.0;
    return sqrt((px - x) * (px - x) + (py - y) * (py - y));
}

/* Height (m) of the pass half way between two vertices. */
static double pass_height(
    const MeshTable *table, const PassRule *rule, Triangle at, Triangle beyond, int64_t first, int64_t second)
{
    double here = table->height[vertex_index(table, at)], there = table->height[vertex_index(table, beyond)];
    double relief = edge_relief(table, at, beyond, first, second);
    double top = greatest(here, there) + rule->rise * relief, x = 0.0, y = 0.0;
    const int64_t corners[2] = {first, second};
    for (int64_t k = 0; k < 2; k++) {
        int64_t site = site_index(table, at.row, at.column, corners[k]);
        double rise = rule->low_rise * 0.5 * (relief + table->site_relief[site]);
        top = least(top, table->site_low[site] + rise);
        x += 0.5 * ((double)CORNER_X[corners[k]] + table->site_x[site]);
        y += 0.5 * ((double)CORNER_Y[corners[k]] + table->site_y[site]);
    }
    double slope = rule->slope * relief;
    slope *= rule->length / (1.0 + slope);
    top = least(top, here + slope * centroid_distance(table, at.row, at.column, at, x, y));
    top = least(top, there + slope * centroid_distance(table, at.row, at.column, beyond, x, y));
    return greatest(greatest(top, here), there);
}

double edge_height(
    const MeshTable *table, const PassRule *rule, int64_t row, int64_t column, int64_t half,
    int64_t first, int64_t second, double third)
{
    Triangle at = {row, column, half};
    int64_t side = quad_side(first, second), vertex = vertex_index(table, at);
    Triangle beyond = neighbour(table, at, side);
    int64_t other = vertex_index(table, beyond);
    double here = table->height[vertex], there = table->height[other];
    double t = least(greatest(0.5 - 1.5 * third, 0.0), 0.5); /* of the way to the other vertex */
    if (table->receiver[vertex] == side || table->receiver[other] == opposite(side)) {
        double low = here < there ? here : there, high = here < there ? there : here;
        double s = here < there ? t : 1.0 - t;
        return low + (high - low) * s * (0.6 + 0.4 * s);
    }
    double top = pass_height(table, rule, at, beyond, first, second), s = 2.0 * t;
    return here + (top - here) * s * (1.3 - 0.3 * s);
}
