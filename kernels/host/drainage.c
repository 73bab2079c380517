#include "drainage.h"

static const double layers = 5.0; /* thickness of a pair of hard and soft layers, spacings of level 0 */
static const double layer_edge = 2.0; /* steepness of the change between them */
static const double cliff_slope = 1.7, bench_slope = 0.35; /* of full strata, over those of even rock */
static const double relaxation = 0.5; /* share of the step to the built heights that a round takes */
static const double warp = 0.5; /* coarse nodes by which heights of a finer level are moved: off D8's axes */
static const double coarse_repose = 0.92; /* over that of the finer level: channels there lie closer */
static const double ramp = 0.8, least_ramp = 0.7;
enum { SLOPE_SWEEPS = 2, RAMP_SWEEPS = 2, BESIDE = 2 /* nodes beside a course that are not to lie lower */ };

enum { OUTSIDE, INNER, OUTLET, OPEN_END }; /* odd: drained; an open end is the last node of a course */

/* The lowest link of a component of basins. */
typedef struct {
    double height;
    int32_t from, to;
} Pass;

typedef struct {
    int64_t size, width;
    double spacing, per_area;
    double *uplift, *repose, *rain, *least, *strata, *height, *area, *previous, *rise, *scratch;
    int32_t *forced, *receiver, *order, *basin, *nodes, *joined;
    int8_t *kind, *donors;
} Level;

static Level level_of(const DrainageRasters *from)
{
    int64_t n = from->rows * from->width;
    double *r = from->reals;
    int32_t *i = from->integers;
    return (Level){n, from->width, from->spacing, from->per_area, r, r + n, r + 2 * n, r + 3 * n, r + 4 * n,
        r + 5 * n, r + 6 * n, r + 7 * n, r + 8 * n, r + 9 * n, i, i + n, i + 2 * n, i + 3 * n, i + 4 * n,
        i + 5 * n, from->bytes, from->bytes + n};
}

/* Neighbours of a node, in the order in which they are visited. */
static void neighbours(int64_t width, int64_t steps[8])
{
    const int64_t found[8] = {-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1};
    for (int k = 0; k < 8; k++)
        steps[k] = found[k];
}

/* 64 hashed bits of a node (SplitMix64's finalizer). */
static inline uint64_t node_hash(int64_t row, int64_t column, int64_t level)
{
    uint64_t h = (uint64_t)row * UINT64_C(0x9E3779B97F4A7C15);
    h = (h ^ (h >> 29)) + (uint64_t)column * UINT64_C(0xD1B54A32D192ED03);
    h = (h ^ (h >> 30)) * UINT64_C(0xBF58476D1CE4E5B9) + (uint64_t)level;
    h = (h ^ (h >> 27)) * UINT64_C(0x94D049BB133111EB);
    return h ^ (h >> 31);
}

typedef struct {
    double y, x;
} Shift;

/* A hashed vector at a coarse node, in coarse nodes. */
static inline Shift node_shift(int64_t row, int64_t column, int64_t level)
{
    uint64_t bits = node_hash(row, column, level);
    double scale = 2.0 * warp * 0x1p-32;
    return (Shift){scale * (double)(bits >> 32) - warp, scale * (double)(uint32_t)bits - warp};
}

/* Interpolate coarse heights near a fine node, at a place moved by the vectors around it. Heights that are
 * missing leave their weight to the others; NaN if all are. */
static double upsampled(
    int64_t rows, int64_t columns, const double coarse[restrict rows][columns], int64_t first_row,
    int64_t first_column, int64_t level, int64_t row, int64_t column)
{
    int64_t i = row >> 1, j = column >> 1, a = i + (row & 1), b = j + (column & 1);
    if (i < -1 || j < -1 || a > rows || b > columns)
        return NAN;
    int64_t p = i + first_row, q = j + first_column;
    Shift sw = node_shift(p, q, level);
    Shift se = b > j ? node_shift(p, q + 1, level) : sw;
    Shift nw = a > i ? node_shift(p + 1, q, level) : sw;
    Shift ne = a == i ? se : b == j ? nw : node_shift(p + 1, q + 1, level);
    double y = 0.5 * (double)row + 0.25 * (sw.y + ne.y + (se.y + nw.y));
    double x = 0.5 * (double)column + 0.25 * (sw.x + ne.x + (se.x + nw.x));
    i = (int64_t)floor(y), j = (int64_t)floor(x);
    y -= (double)i, x -= (double)j;
    if (i >= 0 && j >= 0 && i < rows - 1 && j < columns - 1) {
        double south = coarse[i][j] + x * (coarse[i][j + 1] - coarse[i][j]);
        double north = coarse[i + 1][j] + x * (coarse[i + 1][j + 1] - coarse[i + 1][j]);
        double z = south + y * (north - south);
        if (z == z)
            return z;
    }
    double total = 0.0, weights = 0.0;
    for (int64_t k = 0; k < 4; k++) {
        p = i + k / 2, q = j + k % 2;
        if (p < 0 || q < 0 || p >= rows || q >= columns || coarse[p][q] != coarse[p][q])
            continue;
        double weight = (k / 2 ? y : 1.0 - y) * (k % 2 ? x : 1.0 - x);
        total += weight * coarse[p][q];
        weights += weight;
    }
    return weights > 0.0 ? total / weights : NAN;
}

/* Lower nodes below the course that flows into them: courses with an open end must not lead uphill. */
static void carve_courses(Level level)
{
    int8_t *is_head = level.donors;
    for (int64_t at = 0; at < level.size; at++)
        is_head[at] = level.forced[at] >= 0;
    for (int64_t at = 0; at < level.size; at++)
        if (level.forced[at] >= 0)
            is_head[level.forced[at]] = 0;
    for (int64_t head = 0; head < level.size; head++) {
        int64_t at = head;
        for (int64_t k = 0; is_head[head] && k < level.size; k++) {
            int64_t to = level.forced[at];
            if (to < 0 || level.kind[to] == OUTLET)
                break;
            level.height[to] = least(level.height[to], level.height[at] - LEAST_RISE);
            at = to;
            if (level.forced[to] < 0)
                level.kind[to] = OPEN_END;
        }
        is_head[head] = 0;
    }
}

bool pack_drainage(
    const DrainageRasters *rasters, int64_t start_rows, int64_t start_columns,
    const double uplift[restrict rasters->rows - 2][rasters->width - 2],
    const double repose[restrict rasters->rows - 2][rasters->width - 2],
    const double rain[restrict rasters->rows - 2][rasters->width - 2],
    const double base[restrict rasters->rows - 2][rasters->width - 2],
    const bool domain[restrict rasters->rows - 2][rasters->width - 2],
    const int32_t course[restrict (rasters->rows - 2) * (rasters->width - 2)],
    const double onto[restrict rasters->rows - 2][rasters->width - 2],
    const double start[restrict start_rows][start_columns], int64_t row, int64_t column, int64_t level,
    int64_t start_row, int64_t start_column)
{
    const int64_t width = rasters->width, rows = rasters->rows - 2, columns = width - 2;
    const Level to = level_of(rasters);
    for (int64_t at = 0; at < to.size; at++) {
        to.uplift[at] = to.repose[at] = to.rain[at] = to.strata[at] = to.area[at] = 0.0;
        to.least[at] = -INFINITY;
        to.height[at] = INFINITY;
        to.forced[at] = to.receiver[at] = -1;
        to.kind[at] = OUTSIDE;
        to.donors[at] = 0;
    }
    double lowest = INFINITY;
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++)
            lowest = domain[i][j] ? least(lowest, base[i][j]) : lowest;
    lowest = lowest == INFINITY ? 0.0 : lowest;
    double gentler = 1.0;
    for (int64_t k = 0; k < level; k++)
        gentler *= coarse_repose;
    bool courses = false;
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++) {
            if (!domain[i][j])
                continue;
            int64_t at = (i + 1) * width + j + 1, next = course[i * columns + j];
            to.uplift[at] = uplift[i][j];
            to.repose[at] = gentler * repose[i][j];
            to.rain[at] = rain[i][j];
            if (base[i][j] == base[i][j]) {
                to.kind[at] = OUTLET;
                to.height[at] = base[i][j];
                continue;
            }
            to.kind[at] = INNER;
            if (next >= 0 && domain[next / columns][next % columns]) {
                int64_t p = next / columns, q = next % columns;
                if (p < i - 1 || p > i + 1 || q < j - 1 || q > j + 1 || (p == i && q == j))
                    return false;
                to.forced[at] = (int32_t)((p + 1) * width + q + 1);
                courses = true;
            }
            double z = upsampled(
                start_rows, start_columns, start, start_row, start_column, level, i + row - 2 * start_row,
                j + column - 2 * start_column);
            if (onto[i][j] == onto[i][j]) {
                to.height[at] = onto[i][j] + (z == z ? z : 0.0);
            } else if (z == z) {
                to.height[at] = z;
            } else {
                double noise = (double)(node_hash(i + row, j + column, level) >> 11) * 0x1p-53;
                to.height[at] = lowest + (0.01 * to.spacing) * noise;
            }
        }
    if (courses)
        carve_courses(to);
    return true;
}

/* Find each node's neighbour of steepest descent, -1 if there is none. */
static void find_lowest(
    int64_t rows, int64_t width, const double height[restrict rows][width],
    int32_t receiver[restrict rows][width])
{
    double diagonal = sqrt(0.5);
    for (int64_t i = 1; i < rows - 1; i++) {
        const double *here = height[i], *south = height[i - 1], *north = height[i + 1];
        for (int64_t j = 1; j < width - 1; j++) {
            double z = here[j - 1], corner = south[j - 1];
            int64_t step = -1, slant = -width - 1;
            step = here[j + 1] < z ? 1 : step;
            z = least(z, here[j + 1]);
            step = south[j] < z ? -width : step;
            z = least(z, south[j]);
            step = north[j] < z ? width : step;
            z = least(z, north[j]);
            slant = south[j + 1] < corner ? 1 - width : slant;
            corner = least(corner, south[j + 1]);
            slant = north[j - 1] < corner ? width - 1 : slant;
            corner = least(corner, north[j - 1]);
            slant = north[j + 1] < corner ? width + 1 : slant;
            corner = least(corner, north[j + 1]);
            double fall = here[j] - z, steep = (here[j] - corner) * diagonal;
            step = steep > fall ? slant : step;
            fall = greatest(fall, steep);
            receiver[i][j] = (int32_t)(fall > 0.0 ? i * width + j + step : -1);
        }
    }
}

/* Apply courses, count donors, and list drained nodes without receiver; returns their number. */
static int64_t apply_courses(Level level, int32_t *restrict roots)
{
    int64_t count = 0;
    for (int64_t at = 0; at < level.size; at++)
        level.donors[at] = 0;
    for (int64_t at = 0; at < level.size; at++) {
        if (!(level.kind[at] & 1)) {
            level.receiver[at] = -1;
            continue;
        }
        if (level.forced[at] >= 0)
            level.receiver[at] = level.forced[at];
        if (level.receiver[at] >= 0)
            level.donors[level.receiver[at]]++;
        else
            roots[count++] = (int32_t)at;
    }
    return count;
}

static void count_donors(Level level)
{
    for (int64_t at = 0; at < level.size; at++)
        level.donors[at] = 0;
    for (int64_t at = 0; at < level.size; at++)
        if (level.receiver[at] >= 0)
            level.donors[level.receiver[at]]++;
}

/* Return the component that a basin has been joined with. */
static int32_t component(int32_t *joined, int32_t label)
{
    while (joined[label] != label)
        label = joined[label] = joined[joined[label]];
    return label;
}

/* Label what drains to a root, and append it to the nodes; returns their number. */
static int64_t upstream(Level level, int32_t root, int32_t label, const int64_t steps[8], int64_t count)
{
    level.basin[root] = label;
    level.nodes[count] = root;
    int64_t seen = count++;
    while (seen < count) {
        int64_t at = level.nodes[seen++];
        for (int k = 0; k < 8; k++) {
            int64_t other = at + steps[k];
            if (level.receiver[other] == at) {
                level.basin[other] = label;
                level.nodes[count++] = (int32_t)other;
            }
        }
    }
    return count;
}

/* Reverse the path from a node to its pit, and let the node drain elsewhere. */
static void reroot(int32_t *receiver, int32_t at, int32_t to)
{
    while (at >= 0) {
        int32_t following = receiver[at];
        receiver[at] = to;
        to = at;
        at = following;
    }
}

/* Route a pit that a course leads to out of its basin, the least-cost way that crosses no course. */
static void release(Level level, int32_t root, const int64_t steps[8])
{
    HeapEntry *heap = (HeapEntry *)level.scratch;
    int32_t *basin = level.basin, *came = level.joined;
    int64_t count = 0;
    for (int64_t at = 0; at < level.size; at++)
        basin[at] = came[at] = -1;
    upstream(level, root, 0, steps, 0);
    came[root] = root;
    heap_push(heap, &count, level.height[root], root);
    while (count > 0) {
        HeapEntry lowest = heap_pop(heap, &count);
        int64_t at = lowest.index;
        if (basin[at] < 0) {
            while (at != root) {
                level.receiver[came[at]] = (int32_t)at;
                at = came[at];
            }
            return;
        }
        for (int k = 0; k < 8; k++) {
            int64_t other = at + steps[k];
            if (level.kind[other] == OUTSIDE || came[other] >= 0)
                continue;
            if (basin[other] >= 0 && level.forced[other] >= 0)
                continue;
            came[other] = (int32_t)at;
            heap_push(heap, &count, greatest(lowest.level, level.height[other]), other);
        }
    }
}

/* Whether a link between nodes is lower than a pass, or comes first of equal ones. */
static bool is_lower(double height, int32_t a, int32_t b, Pass pass)
{
    if (pass.from < 0 || height != pass.height)
        return pass.from < 0 || !(height > pass.height);
    int32_t low = a < b ? a : b, pass_low = pass.from < pass.to ? pass.from : pass.to;
    return low != pass_low ? low < pass_low : a + b - low < pass.from + pass.to - pass_low;
}

/* Route the basins of pits through their lowest passes: the minimum spanning tree of basins, by Boruvka.
 *
 * A component of basins drains through its lowest pass, if that does not lead into it. Links are ordered by
 * height and position. A part of the domain without any outlet keeps one of its pits. */
static void connect_basins(Level level, int32_t *restrict roots, int32_t drained)
{
    int64_t steps[8], count = 0;
    int32_t *basin = level.basin, *nodes = level.nodes, *joined = level.joined, open_ended = 0;
    Pass *pass = (Pass *)level.scratch;
    neighbours(level.width, steps);
    for (int64_t at = 0; at < level.size; at++)
        basin[at] = drained;
    for (int32_t number = 0; number < drained; number++) {
        int64_t first = count;
        bool is_open = false;
        count = upstream(level, roots[number], number, steps, count);
        for (int64_t k = first; k < count; k++)
            is_open |= level.kind[nodes[k]] == OPEN_END;
        if (!is_open)
            continue;
        /* Paths in it must not be reversed, since courses may be part of them. */
        while (count > first)
            basin[nodes[--count]] = drained;
        roots[open_ended++] = roots[number];
    }
    for (int32_t label = 0; label <= drained; label++)
        joined[label] = label;
    while (count > 0) {
        int64_t kept = 0;
        for (int32_t label = 0; label < drained; label++)
            pass[label].from = -1;
        for (int64_t k = 0; k < count; k++) {
            int32_t at = nodes[k], label = component(joined, basin[at]);
            if (label == drained)
                continue;
            bool border = false;
            for (int n = 0; n < 8; n++) {
                int32_t other = at + (int32_t)steps[n];
                if (basin[other] == basin[at] || level.kind[other] == OUTSIDE)
                    continue;
                if (component(joined, basin[other]) == label)
                    continue;
                border = true;
                double z = greatest(level.height[at], level.height[other]);
                if (is_lower(z, at, other, pass[label]))
                    pass[label] = (Pass){z, at, other};
            }
            if (border)
                nodes[kept++] = at;
        }
        count = kept;
        for (int32_t label = 0; label < drained; label++) {
            if (pass[label].from < 0)
                continue;
            int32_t to = component(joined, basin[pass[label].to]);
            if (to != label) {
                reroot(level.receiver, pass[label].from, pass[label].to);
                joined[label] = to;
            }
        }
    }
    for (int32_t k = 0; k < open_ended; k++)
        release(level, roots[k], steps);
}

/* Sum drainage areas of nodes whose donors are counted; returns the number of nodes in the order of flow. */
static int64_t sum_areas(Level level)
{
    int64_t count = 0;
    for (int64_t at = 0; at < level.size; at++)
        level.area[at] = level.rain[at];
    for (int64_t start = 0; start < level.size; start++) {
        if (level.kind[start] == OUTSIDE || level.donors[start] != 0)
            continue;
        for (int64_t at = start;;) {
            int32_t to = level.receiver[at];
            level.donors[at] = -1;
            level.order[count++] = (int32_t)at;
            if (to < 0)
                break;
            level.area[to] += level.area[at];
            if (--level.donors[to] != 0)
                break;
            at = to;
        }
    }
    return count;
}

static int64_t route(Level level)
{
    for (int64_t at = 0; at < level.size; at++)
        level.previous[at] = level.height[at];
    int64_t width = level.width, rows = level.size / width;
    find_lowest(rows, width, (const double(*)[width])level.height, (int32_t(*)[width])level.receiver);
    int64_t roots = apply_courses(level, level.order);
    if (roots > 0) {
        connect_basins(level, level.order, (int32_t)roots);
        count_donors(level);
    }
    return sum_areas(level);
}

/* Find the rise of each node to the next (m), of the drainage area at its middle, so that levels agree. */
static void find_rises(
    int64_t size, double spacing, double per_area, const double uplift[restrict size],
    const double repose[restrict size], const double rain[restrict size], const double area[restrict size],
    const int32_t forced[restrict size], double rise[restrict size])
{
    for (int64_t at = 0; at < size; at++) {
        double quarter = sqrt(sqrt(greatest((area[at] - 0.5 * rain[at]) * per_area, 1e-9)));
        double steep = greatest(uplift[at] / (quarter * sqrt(quarter)), LEAST_SLOPE);
        double most = greatest(repose[at], LEAST_SLOPE), low = least(steep, most);
        double a = steep < most ? steep : most, b = steep < most ? most : steep;
        double share = a * a / (b * b);
        double smooth = low / sqrt(sqrt(1.0 + share * share)); /* (steep^-4 + most^-4)^(-1/4) */
        rise[at] = (forced[at] < 0 ? smooth : low) * spacing;
    }
}

/* Return the slope over that of even rock at a height, in pairs of layers. */
static double resistance(double z, double strata)
{
    double cliff = 1.0 + strata * (cliff_slope - 1.0), bench = 1.0 + strata * (bench_slope - 1.0);
    double hard = 0.5 + layer_edge * (fabs(2.0 * (z - floor(z)) - 1.0) - 0.5);
    return bench + (cliff - bench) * least(greatest(hard, 0.0), 1.0);
}

static void integrate(Level level, int64_t count)
{
    find_rises(
        level.size, level.spacing, level.per_area, level.uplift, level.repose, level.rain, level.area,
        level.forced, level.rise);
    const double ways[2] = {1.0, sqrt(2.0)};
    double *height = level.height, per_spacing = sqrt(level.per_area);
    const double *rise = level.rise, *strata = level.strata, *lowest = level.least;
    const int32_t *order = level.order, *receiver = level.receiver;
    int64_t width = level.width;
    for (int64_t k = count - 1; k >= 0; k--) {
        int64_t at = order[k], to = receiver[at];
        if (to < 0)
            continue;
        int64_t step = at > to ? at - to : to - at;
        double up = ways[(step != 1) & (step != width)] * rise[at];
        if (strata[at] > 0.0)
            up *= resistance((height[to] + 0.5 * up) * per_spacing / layers, strata[at]);
        height[at] = greatest(height[to] + up, lowest[at]);
    }
}

/* Limit heights by the four neighbours that precede a node in reading order, or in its reverse. */
static void limit_sweep(
    int64_t size, int64_t width, int64_t direction, const double rise[restrict size],
    double height[restrict size], int32_t receiver[restrict size])
{
    double diagonal = sqrt(2.0);
    int64_t row = direction * width, west = row + direction, east = row - direction;
    for (int64_t k = width + 1; k < size - width - 1; k++) {
        int64_t at = direction > 0 ? k : size - 1 - k;
        double slant = diagonal * rise[at], beside = height[at - direction] + rise[at];
        double below = height[at - row] + rise[at], first = height[at - west] + slant;
        double z = least(least(least(beside, below), first), height[at - east] + slant);
        if (z < height[at]) {
            height[at] = z;
            int64_t step = z == beside ? direction : z == below ? row : z == first ? west : east;
            receiver[at] = (int32_t)(at - step);
        }
    }
}

static void sink(Level level)
{
    double *height = level.height;
    for (int64_t node = 0; node < level.size; node++) {
        if (level.forced[node] < 0 || level.kind[node] != INNER)
            continue;
        double z = height[node];
        for (int64_t row = -BESIDE; row <= BESIDE; row++)
            for (int64_t column = -BESIDE; column <= BESIDE; column++) {
                int64_t other = node + row * level.width + column;
                if (other >= 0 && other < level.size && level.kind[other] == INNER && level.forced[other] < 0)
                    z = least(z, height[other]);
            }
        height[node] = z;
        int64_t at = node, to = level.forced[node];
        while (to >= 0 && (level.kind[to] & 1) && height[to] >= height[at]) {
            height[to] = height[at] - LEAST_RISE;
            at = to;
            to = level.forced[at];
        }
    }
}

static void limit(Level level)
{
    double *restrict rise = level.scratch;
    for (int64_t at = 0; at < level.size; at++) {
        double repose = level.repose[at] * (1.0 + (cliff_slope - 1.0) * level.strata[at]);
        bool is_limited = level.kind[at] == INNER && level.forced[at] < 0;
        rise[at] = is_limited ? greatest(repose, LEAST_SLOPE) * level.spacing : INFINITY;
    }
    for (int64_t sweep = 0; sweep < 2 * SLOPE_SWEEPS; sweep++)
        limit_sweep(
            level.size, level.width, sweep % 2 ? -1 : 1, rise, level.height, level.receiver);
    sink(level);
}

static void relax(
    int64_t size, const int8_t kind[restrict size], const double previous[restrict size],
    double height[restrict size])
{
    for (int64_t at = 0; at < size; at++) {
        double part = previous[at] + relaxation * (height[at] - previous[at]);
        height[at] = kind[at] & 1 ? part : height[at];
    }
}

void run_drainage(const DrainageRasters *rasters, int64_t rounds)
{
    Level level = level_of(rasters);
    for (int64_t number = 0; number < rounds; number++) {
        integrate(level, route(level));
        limit(level);
        if (number < rounds - 1)
            relax(level.size, level.kind, level.previous, level.height);
    }
    integrate(level, accumulate_drainage(rasters)); /* by the receivers as they are after the last round */
}

int64_t route_drainage(const DrainageRasters *rasters) { return route(level_of(rasters)); }

int64_t accumulate_drainage(const DrainageRasters *rasters)
{
    Level level = level_of(rasters);
    count_donors(level);
    return sum_areas(level);
}

void integrate_drainage(const DrainageRasters *rasters, int64_t count)
{
    integrate(level_of(rasters), count);
}

void limit_slopes(const DrainageRasters *rasters) { limit(level_of(rasters)); }

void sink_courses(const DrainageRasters *rasters) { sink(level_of(rasters)); }

void carve_barriers(
    const DrainageRasters *rasters, int64_t count, const double lowest[rasters->rows][rasters->width])
{
    Level level = level_of(rasters);
    for (int64_t k = 0; k < count; k++) {
        int64_t at = level.order[k], to = level.receiver[at];
        if (to >= 0 && (level.kind[to] & 1)) {
            double below = greatest(level.height[at] - LEAST_SLOPE * level.spacing, ((const double *)lowest)[to]);
            level.height[to] = least(level.height[to], below);
        }
    }
}

void relax_heights(const DrainageRasters *rasters)
{
    Level level = level_of(rasters);
    relax(level.size, level.kind, level.previous, level.height);
}

void drainage_shares(
    const DrainageRasters *rasters, int64_t count, double weight[restrict rasters->rows][rasters->width])
{
    Level level = level_of(rasters);
    double *share = weight[0];
    for (int64_t at = 0; at < level.size; at++)
        share[at] *= level.rain[at];
    for (int64_t k = 0; k < count; k++) {
        int64_t at = level.order[k], to = level.receiver[at];
        if (to >= 0)
            share[to] += share[at];
        share[at] /= level.area[at];
    }
}

void outlet_ramps(
    int64_t rows, int64_t columns, const double base[restrict rows][columns],
    const double repose[restrict rows][columns], const bool domain[restrict rows][columns], double spacing,
    double lowest[restrict rows][columns])
{
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++)
            lowest[i][j] = base[i][j] == base[i][j] ? base[i][j] : -INFINITY;
    for (int64_t sweep = 0; sweep < 2 * RAMP_SWEEPS; sweep++)
        for (int64_t k = 0; k < rows * columns; k++) {
            int64_t cell = sweep % 2 ? rows * columns - 1 - k : k, i = cell / columns, j = cell % columns;
            if (!domain[i][j] || base[i][j] == base[i][j])
                continue;
            double fall = greatest(ramp * repose[i][j], least_ramp) * spacing;
            for (int64_t a = greatest_index(i - 1, 0); a < least_index(i + 2, rows); a++)
                for (int64_t b = greatest_index(j - 1, 0); b < least_index(j + 2, columns); b++) {
                    double slant = a != i && b != j ? sqrt(2.0) : 1.0;
                    if (domain[a][b])
                        lowest[i][j] = greatest(lowest[i][j], lowest[a][b] - slant * fall);
                }
        }
}

/* Return the coarse node nearest to a fine one (halves are rounded up), -1 if the raster has none. */
static int64_t coarse_node(
    int64_t at, int64_t columns, int64_t first_row, int64_t first_column, int64_t coarse_rows,
    int64_t coarse_columns)
{
    int64_t i = (at / columns - first_row + 1) >> 1, j = (at % columns - first_column + 1) >> 1;
    bool inside = i >= 0 && j >= 0 && i < coarse_rows && j < coarse_columns;
    return inside ? i * coarse_columns + j : -1;
}

/* Write the steps from each node of a course to its end, -1 elsewhere; false if one runs in a circle. */
static bool steps_to_end(
    int64_t size, const int32_t course[restrict size], int32_t left[restrict size],
    int32_t path[restrict size])
{
    for (int64_t at = 0; at < size; at++)
        left[at] = -1;
    for (int64_t head = 0; head < size; head++) {
        int64_t at = head, count = 0;
        while (course[at] >= 0 && left[at] < 0) {
            path[count++] = (int32_t)at;
            if (count == size)
                return false;
            at = course[at];
        }
        if (count > 0 && left[at] < 0)
            left[at] = 0;
        for (int32_t steps = left[at]; count > 0;)
            left[path[--count]] = ++steps;
    }
    return true;
}

bool coarsen_drainage(
    int64_t rows, int64_t columns, int64_t coarse_rows, int64_t coarse_columns,
    const double uplift[restrict rows][columns], const double repose[restrict rows][columns],
    const double rain[restrict rows][columns], const double base[restrict rows][columns],
    const bool domain[restrict rows][columns], const int32_t course[restrict rows * columns],
    int64_t first_row, int64_t first_column, double fields[restrict 4][coarse_rows][coarse_columns],
    bool domains[restrict coarse_rows][coarse_columns],
    int32_t courses[restrict coarse_rows * coarse_columns], int32_t scratch[restrict 3][rows * columns])
{
    for (int64_t i = 0; i < coarse_rows; i++)
        for (int64_t j = 0; j < coarse_columns; j++) {
            int64_t p = 2 * i + first_row, q = 2 * j + first_column;
            double count = 0.0, lowest = INFINITY, uplifts = 0.0, reposes = 0.0, rains = 0.0;
            domains[i][j] = domain[p][q];
            for (int64_t a = greatest_index(p - 1, 0); domain[p][q] && a < least_index(p + 2, rows); a++)
                for (int64_t b = greatest_index(q - 1, 0); b < least_index(q + 2, columns); b++) {
                    if (!domain[a][b])
                        continue;
                    count += 1.0;
                    uplifts += uplift[a][b];
                    reposes += repose[a][b];
                    rains += rain[a][b];
                    lowest = least(lowest, base[a][b]);
                }
            fields[0][i][j] = domain[p][q] ? uplifts / count : 0.0;
            fields[1][i][j] = domain[p][q] ? reposes / count : 0.0;
            fields[2][i][j] = domain[p][q] ? rains * (4.0 / count) : 0.0;
            bool outlet = domain[p][q] && (base[p][q] == base[p][q] || lowest < INFINITY);
            fields[3][i][j] = !outlet ? NAN : base[p][q] == base[p][q] ? base[p][q] : lowest;
        }
    int32_t *left = scratch[0], *last = scratch[2];
    if (!steps_to_end(rows * columns, course, left, scratch[1]))
        return false;
    int64_t coarse = coarse_rows * coarse_columns;
    for (int64_t at = 0; at < coarse; at++)
        last[at] = courses[at] = -1;
    for (int64_t at = 0; at < rows * columns; at++) {
        int64_t to = coarse_node(at, columns, first_row, first_column, coarse_rows, coarse_columns);
        if (left[at] >= 0 && to >= 0 && (last[to] < 0 || left[at] < left[last[to]]))
            last[to] = (int32_t)at;
    }
    for (int64_t at = 0; at < coarse; at++) {
        if (last[at] < 0 || course[last[at]] < 0 || !domains[at / coarse_columns][at % coarse_columns])
            continue;
        int64_t next = course[last[at]];
        int64_t to = coarse_node(next, columns, first_row, first_column, coarse_rows, coarse_columns);
        if (to >= 0 && domains[to / coarse_columns][to % coarse_columns])
            courses[at] = (int32_t)to;
    }
    return true;
}
