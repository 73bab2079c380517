#include "mesh_nodes.h"
#include "drainage.h"
#include "noise.h"
#include "wetness.h"

static const double CLEARLY = 1e-6; /* inside of a triangle, L²: in no other one, whatever is rounded */
/* Bits of the cells (mesh units) and amplitudes (L) of the noise that displaces cells' borders. */
static const int64_t WARP_BITS[2] = {9, 7};
static const double WARP_AMPLITUDE[2] = {0.13, 0.035}, WARP = 0.13 + 0.035;

/* The triangle of a point, in L from the lattice point of its quad: there, or around it. */
static Triangle triangle_at(const MeshTable *table, int64_t row, int64_t column, double x, double y)
{
    for (int64_t trial = 0; trial < 18; trial++) {
        int64_t quad = (trial / 2 + 4) % 9;
        Triangle at = {row + quad / 3 - 1, column + quad % 3 - 1, trial % 2};
        if (at.row < 0 || at.column < 0 || at.row >= table->rows || at.column >= table->columns)
            continue;
        double corner[6], area[3];
        triangle_corners(table, at, corner);
        corner_areas(corner, x - (double)(at.column - column), y - (double)(at.row - row), area);
        if (least(least(area[0], area[1]), area[2]) >= 0.0)
            return at;
    }
    return (Triangle){-1, -1, 0};
}

void node_places(
    const MeshParameters *mesh, const MeshTable *table, int64_t level, int64_t column, int64_t row,
    int64_t rows, int64_t columns, int32_t place[restrict rows][columns][5],
    double third[restrict rows][columns], double away[restrict rows][columns],
    double scratch[restrict 2][columns])
{
    const double scale = 1.0 / UNIT;
    const int64_t step = INT64_C(1) * SIDE << level, x = column * step;
    const MeshTable sites = *table; /* which nothing that is written can alias */
    double *restrict east = scratch[0], *restrict north = scratch[1], corner[6] = {0.0}, area[3];
    const int64_t *number = CORNERS[0][0];
    Triangle at = {0, 0, 0};
    for (int64_t j = 0; j < rows; j++) {
        int64_t y = (row + j) * step;
        for (int64_t i = 0; i < columns; i++)
            east[i] = north[i] = 0.0;
        for (int64_t k = 0; k < 2; k++) {
            uint64_t key = (uint64_t)WARP_BITS[k];
            value_noise_row(mesh->warp_x + key, x, step, y, WARP_BITS[k], WARP_AMPLITUDE[k], columns, east);
            value_noise_row(mesh->warp_y + key, x, step, y, WARP_BITS[k], WARP_AMPLITUDE[k], columns, north);
        }
        for (int64_t i = 0; i < columns; i++) {
            int64_t p = (x + i * step) >> UNIT_BITS, q = y >> UNIT_BITS;
            double px = (double)(x + i * step - p * UNIT) * scale + east[i];
            double py = (double)(y - q * UNIT) * scale + north[i];
            int64_t shift_x = (int64_t)floor(px), shift_y = (int64_t)floor(py);
            int64_t c = p + shift_x - sites.column, r = q + shift_y - sites.row;
            px -= (double)shift_x;
            py -= (double)shift_y;
            corner_areas(corner, px - (double)(at.column - c), py - (double)(at.row - r), area);
            if (least(least(area[0], area[1]), area[2]) < CLEARLY) { /* not in that of the node before */
                at = triangle_at(&sites, r, c, px, py);
                if (at.row >= 0) {
                    number = triangle_numbers(&sites, at);
                    triangle_corners(&sites, at, corner);
                }
                corner_areas(corner, px - (double)(at.column - c), py - (double)(at.row - r), area);
            }
            int64_t k0 = area[0] < area[1], k1 = 1 - k0, k2 = 2; /* from the greatest area to the least */
            if (area[k1] < area[2]) {
                k2 = k1;
                k1 = 2;
                if (area[k0] < area[2]) {
                    k1 = k0;
                    k0 = 2;
                }
            }
            double total = area[k0] + area[k1] + area[k2];
            third[j][i] = area[k2] / total;
            away[j][i] = (area[k0] - area[k1]) / total;
            int32_t *here = place[j][i];
            here[0] = (int32_t)at.row;
            here[1] = (int32_t)at.column;
            here[2] = (int32_t)at.half;
            here[3] = (int32_t)number[k0];
            here[4] = (int32_t)number[k1];
        }
    }
}

void cell_bounds(const MeshTable *table, double bounds[restrict table->rows][table->columns][4])
{
    for (int64_t j = 0; j < table->rows; j++)
        for (int64_t i = 0; i < table->columns; i++) {
            double *box = bounds[j][i];
            box[0] = box[1] = box[2] = box[3] = 0.0;
            if (i == 0 || j == 0)
                continue;
            double west = INFINITY, south = INFINITY, east = -INFINITY, north = -INFINITY;
            for (int64_t triangle = 0; triangle < 8; triangle++) {
                Triangle at = {j - 1 + triangle / 4, i - 1 + triangle / 2 % 2, triangle % 2};
                const int64_t *number = triangle_numbers(table, at);
                double x[3], y[3];
                int64_t own = -1;
                for (int64_t k = 0; k < 3; k++) {
                    int64_t r = at.row + CORNER_Y[number[k]], c = at.column + CORNER_X[number[k]];
                    x[k] = (double)c + table->site_x[r * (table->columns + 1) + c];
                    y[k] = (double)r + table->site_y[r * (table->columns + 1) + c];
                    if (r == j && c == i)
                        own = k;
                }
                /* The middles of sides at the site, and the centroid. */
                for (int64_t k = 0; k < 3 && own >= 0; k++) {
                    double a = k != own ? 0.5 * (x[own] + x[k]) : (x[0] + x[1] + x[2]) / 3.0;
                    double b = k != own ? 0.5 * (y[own] + y[k]) : (y[0] + y[1] + y[2]) / 3.0;
                    west = least(west, a);
                    east = greatest(east, a);
                    south = least(south, b);
                    north = greatest(north, b);
                }
            }
            box[0] = west - WARP;
            box[1] = south - WARP;
            box[2] = east + WARP;
            box[3] = north + WARP;
        }
}

void mesh_heights(
    const MeshTable *table, const PassRule *rule, double rise, int64_t rows, int64_t columns,
    const int32_t place[restrict rows][columns][5], const double third[restrict rows][columns],
    const double away[restrict rows][columns], double height[restrict rows][columns])
{
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++) {
            const int32_t *at = place[j][i];
            double edge = edge_height(table, rule, at[0], at[1], at[2], at[3], at[4], third[j][i]);
            int64_t site = site_index(table, at[0], at[1], at[3]);
            double crest = table->site_low[site] + rise * table->site_relief[site];
            height[j][i] = edge + (greatest(crest, edge) - edge) * away[j][i] * (2.0 - away[j][i]);
        }
}

void cell_borders(
    const MeshTable *table, const PassRule *rule, int64_t rows, int64_t columns, int64_t count,
    const int32_t place[restrict rows][columns][5], const double third[restrict rows][columns],
    const int32_t number[restrict table->rows + 1][table->columns + 1],
    int32_t owner[restrict rows][columns], double base[restrict rows][columns],
    double inflow[restrict rows][columns], int64_t boxes[restrict count][4])
{
    for (int64_t k = 0; k < count; k++)
        for (int64_t side = 0; side < 4; side++)
            boxes[k][side] = 0;
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++) {
            const int32_t *at = place[j][i];
            int32_t own = owner[j][i] = ((const int32_t *)number)[site_index(table, at[0], at[1], at[3])];
            if (own < 0)
                continue;
            int64_t *box = boxes[own];
            bool is_first = box[2] == 0;
            box[0] = is_first ? j : box[0];
            box[1] = is_first ? i : least_index(box[1], i);
            box[2] = j + 1;
            box[3] = greatest_index(box[3], i + 1);
        }
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++) {
            base[j][i] = NAN;
            inflow[j][i] = 0.0;
            if (i == 0 || j == 0 || i == columns - 1 || j == rows - 1 || owner[j][i] < 0)
                continue;
            const int32_t *south = &owner[j - 1][i], *here = &owner[j][i], *north = &owner[j + 1][i];
            const int32_t own = here[0];
            int32_t beside = (here[-1] ^ own) | (here[1] ^ own) | (south[0] ^ own) | (north[0] ^ own);
            int32_t across = (south[-1] ^ own) | (south[1] ^ own) | (north[-1] ^ own) | (north[1] ^ own);
            if (!(beside | across))
                continue;
            const int32_t *at = place[j][i];
            base[j][i] = edge_height(table, rule, at[0], at[1], at[2], at[3], at[4], third[j][i]);
            double area = edge_inflow(table, (Triangle){at[0], at[1], at[2]}, at[3], at[4]);
            inflow[j][i] = area * (rule->length * rule->length);
        }
}

/* Raise ground below passes that stand above it until it is no steeper than talus. */
static void pile_talus(
    int64_t rows, int64_t columns, double height[restrict rows][columns],
    const double base[restrict rows][columns], const double repose[restrict rows][columns], double slope)
{
    static const int64_t before[4][2] = {{-1, -1}, {-1, 0}, {-1, 1}, {0, -1}};
    static const double reach[4] = {1.4142, 1.0, 1.4142, 1.0};
    for (int64_t sense = 1; sense >= -1; sense -= 2) /* there and back */
        for (int64_t a = 0; a < rows; a++)
            for (int64_t b = 0; b < columns; b++) {
                int64_t j = sense > 0 ? a : rows - 1 - a, i = sense > 0 ? b : columns - 1 - b;
                if (base[j][i] == base[j][i] || height[j][i] != height[j][i])
                    continue;
                double step = slope * repose[j][i];
                for (int64_t k = 0; k < 4; k++) {
                    int64_t y = j + sense * before[k][0], x = i + sense * before[k][1];
                    if (y >= 0 && y < rows && x >= 0 && x < columns)
                        height[j][i] = greatest(height[j][i], height[y][x] - step * reach[k]);
                }
            }
}

/* Drain a cell with these rows and columns from a coarser level, whose place is one of `drain_cells`. */
static void drain_cell(
    const CellNodes *cells, int64_t number, const double *start, const int64_t place[4], double finest,
    int64_t rounds, int64_t first_rounds, double first_uplift, double talus, int64_t rows, int64_t columns,
    double height[restrict rows][columns], double piled[restrict rows][columns],
    float area[restrict rows][columns], float wet[restrict rows][columns], double *reals)
{
    const int64_t south = cells->boxes[4 * number], west = cells->boxes[4 * number + 1];
    static const double nothing = NAN;
    const int64_t size = (rows + 2) * (columns + 2), nodes = rows * columns, width = columns + 2;
    const double spacing = finest * (double)(INT64_C(1) << cells->level);
    double *uplift = reals + 15 * size;
    double *repose = uplift + nodes, *rain = repose + nodes, *base = rain + nodes;
    const DrainageRasters rasters = {
        rows + 2, width, spacing, 1.0 / (finest * finest), reals, (void *)(reals + 11 * size),
        (void *)(reals + 14 * size)};
    bool *domain = (bool *)rasters.bytes + 2 * size;
    int32_t *course = (int32_t *)(rasters.bytes + 4 * size);
    for (int64_t at = 0; at < nodes; at++) {
        int64_t node = (south + at / columns) * cells->columns + west + at % columns;
        domain[at] = cells->owner[node] == number;
        base[at] = domain[at] ? cells->base[node] : NAN;
        uplift[at] = cells->uplift[node];
        repose[at] = cells->repose[node];
        rain[at] = spacing * spacing;
        course[at] = -1;
    }
    const bool is_first = place[0] * place[1] == 0;
    pack_drainage(
        &rasters, is_first ? 1 : place[0], is_first ? 1 : place[1], (void *)uplift, (void *)repose,
        (void *)rain, (void *)base, (void *)domain, course, (void *)base,
        (const void *)(is_first ? &nothing : start), cells->row + south, cells->column + west, cells->level,
        place[2], place[3]);
    if (is_first) {
        for (int64_t at = 0; at < size; at++)
            reals[at] = first_uplift;
        run_drainage(&rasters, first_rounds);
        for (int64_t at = 0; at < nodes; at++)
            reals[(at / columns + 1) * width + at % columns + 1] = uplift[at];
    }
    run_drainage(&rasters, rounds);
    double *areas = rain; /* which is not needed any more */
    for (int64_t i = 0; i < rows; i++)
        for (int64_t j = 0; j < columns; j++) {
            int64_t at = i * columns + j, packed = (i + 1) * width + j + 1;
            double inflow = cells->inflow[(south + i) * cells->columns + west + j];
            height[i][j] = piled[i][j] = domain[at] ? reals[5 * size + packed] : NAN;
            areas[at] = domain[at] ? reals[6 * size + packed] + inflow : 0.0;
            area[i][j] = (float)areas[at];
        }
    pile_talus(rows, columns, piled, (void *)base, (void *)repose, talus * spacing);
    wetness(rows, columns, piled, (void *)areas, spacing, finest, wet, (void *)reals);
}

void drain_cells(
    const CellNodes *cells, int64_t coarse_nodes, const double coarse[restrict coarse_nodes],
    const int64_t starts[restrict cells->count][4], double finest,
    const int64_t rounds[restrict cells->count], int64_t first_rounds, double first_uplift, double talus,
    int64_t nodes, double height[restrict nodes], double piled[restrict nodes], float area[restrict nodes],
    float wet[restrict nodes], int64_t room, double scratch[restrict room])
{
    for (int64_t k = 0; k < cells->count; k++) {
        const int64_t *box = cells->boxes + 4 * k, *from = starts[k];
        int64_t rows = box[2] - box[0], columns = box[3] - box[1];
        if (rows > 0)
            drain_cell(
                cells, k, coarse, from, finest, rounds[k], first_rounds, first_uplift, talus, rows, columns,
                (void *)height, (void *)piled, (void *)area, (void *)wet, scratch);
        coarse += from[0] * from[1];
        height += rows * columns;
        piled += rows * columns;
        area += rows * columns;
        wet += rows * columns;
    }
}

void paste_cell(
    int64_t cell_rows, int64_t cell_columns, const double cell_height[restrict cell_rows][cell_columns],
    const float cell_area[restrict cell_rows][cell_columns],
    const float cell_wet[restrict cell_rows][cell_columns], int64_t row, int64_t column, int64_t rows,
    int64_t columns, double height[restrict rows][columns], float area[restrict rows][columns],
    float wet[restrict rows][columns])
{
    for (int64_t j = greatest_index(0, -row); j < least_index(cell_rows, rows - row); j++)
        for (int64_t i = greatest_index(0, -column); i < least_index(cell_columns, columns - column); i++) {
            if (cell_height[j][i] != cell_height[j][i])
                continue;
            height[row + j][column + i] = cell_height[j][i];
            area[row + j][column + i] = cell_area[j][i];
            wet[row + j][column + i] = cell_wet[j][i];
        }
}
