#include <string.h>

#include "mesh_vertices.h"

static const double AVOIDANCE = 0.5; /* share of the relief that valleys avoid */
static const double CEILING = 0.6; /* greatest height above the base level, over the relief upstream */
static const double CAPTURE_SLOPE = 0.06; /* … of captured valleys, over uplift */
static const double KEPT_FALL = 0.75, RISE_SLOPE = 0.12; /* of raised valleys: share of fall, more slope */
static const double LEAST_FALL = 0.02; /* from vertex to vertex, over a trunk's along L */
enum { REPAIRS = 4 }; /* rounds of lifting sinks above their lowest neighbour */

void mesh_vertices(
    int64_t column, int64_t row, int64_t rows, int64_t columns,
    const double site_x[restrict rows + 1][columns + 1], const double site_y[restrict rows + 1][columns + 1],
    const int64_t diagonal[restrict rows][columns], int64_t centre[restrict rows][columns][2][2],
    int64_t probe[restrict rows][columns][2][2])
{
    const MeshTable table = {
        .columns = columns, .site_x = &site_x[0][0], .site_y = &site_y[0][0], .diagonal = &diagonal[0][0]};
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++)
            for (int64_t half = 0; half < 2; half++) {
                double p[6];
                triangle_corners(&table, (Triangle){j, i, half}, p);
                double mx = (p[0] + p[2] + p[4]) / 3.0, my = (p[1] + p[3] + p[5]) / 3.0;
                double ux = p[2] - p[0], uy = p[3] - p[1], vx = p[4] - p[0], vy = p[5] - p[1];
                double area = 2.0 * (ux * vy - uy * vx);
                double uu = ux * ux + uy * uy, vv = vx * vx + vy * vy;
                double qx = p[0] + (vy * uu - uy * vv) / area, qy = p[1] + (ux * vv - vx * uu) / area;
                qx = least(greatest(qx, mx - 1.5), mx + 1.5);
                qy = least(greatest(qy, my - 1.5), my + 1.5);
                centre[j][i][half][0] = (column + i) * UNIT + (int64_t)floor(mx * UNIT);
                centre[j][i][half][1] = (row + j) * UNIT + (int64_t)floor(my * UNIT);
                probe[j][i][half][0] = (column + i) * UNIT + (int64_t)floor(qx * UNIT);
                probe[j][i][half][1] = (row + j) * UNIT + (int64_t)floor(qy * UNIT);
            }
}

void mesh_receivers(
    const MeshParameters *mesh, int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const int64_t probe[restrict rows][columns][2][2], const double relief[restrict rows][columns][2],
    double level[restrict rows][columns][2], int64_t receiver[restrict rows][columns][2],
    double scratch[restrict rows][columns][2])
{
    const MeshTable table = {.rows = rows, .columns = columns, .diagonal = &diagonal[0][0]};
    for (int64_t j = 0; j < rows; j++)
        for (int64_t i = 0; i < columns; i++)
            for (int64_t half = 0; half < 2; half++)
                level[j][i][half] = base_level(mesh, probe[j][i][half][0], probe[j][i][half][1]);
    for (int64_t repair = 0; repair <= REPAIRS; repair++) {
        for (int64_t j = 0; j < rows; j++)
            for (int64_t i = 0; i < columns; i++)
                for (int64_t half = 0; half < 2; half++) {
                    double here = level[j][i][half], lowest = INFINITY, least_ground = INFINITY;
                    int64_t best = -1;
                    for (int64_t k = 0; k < 3; k++) {
                        int64_t side = triangle_side(&table, (Triangle){j, i, half}, k);
                        Triangle beyond = neighbour(&table, (Triangle){j, i, half}, side);
                        if (beyond.row < 0)
                            continue;
                        double there = level[beyond.row][beyond.column][beyond.half];
                        double ground = there + AVOIDANCE * relief[beyond.row][beyond.column][beyond.half];
                        lowest = least(lowest, there);
                        if (there < here && ground < least_ground) {
                            least_ground = ground;
                            best = side;
                        }
                    }
                    receiver[j][i][half] = best;
                    bool is_lifted = lowest >= here && lowest - here < mesh->fall;
                    scratch[j][i][half] = is_lifted ? lowest + LEAST_FALL * mesh->fall : here;
                }
        if (repair < REPAIRS)
            memcpy(level, scratch, sizeof(double) * 2 * (size_t)(rows * columns));
    }
}

/* The flat index of the vertex that one drains to, -1 for none, and the way there (mesh units). */
static int64_t downstream(
    const MeshTable *table, const int64_t (*centre)[2], int64_t vertex, double *restrict way)
{
    Triangle at = {(vertex >> 1) / table->columns, (vertex >> 1) % table->columns, vertex & 1};
    int64_t side = table->receiver[vertex];
    *way = 0.0;
    if (side < 0)
        return -1;
    int64_t to = vertex_index(table, neighbour(table, at, side));
    double dx = (double)(centre[to][0] - centre[vertex][0]), dy = (double)(centre[to][1] - centre[vertex][1]);
    *way = sqrt(dx * dx + dy * dy);
    return to;
}

void mesh_vertex_heights(
    int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const int64_t centre[restrict rows][columns][2][2], const double level[restrict 2 * rows * columns],
    const int64_t order[restrict 2 * rows * columns], const int64_t receiver[restrict rows][columns][2],
    const double relief[restrict 2 * rows * columns], double fall, double per_relief, double cap,
    double metres, int64_t trunk, double height[restrict 2 * rows * columns],
    int64_t upstream[restrict 2 * rows * columns], int64_t below[restrict 2 * rows * columns],
    double scratch[restrict 2][2 * rows * columns])
{
    const MeshTable table = {
        .rows = rows, .columns = columns, .diagonal = &diagonal[0][0], .receiver = &receiver[0][0][0]};
    const int64_t vertices = 2 * rows * columns;
    const double step = LEAST_FALL * fall;
    double *restrict length = scratch[0], *restrict ceiling = scratch[1];
    for (int64_t at = 0; at < vertices; at++) {
        upstream[at] = 1;
        height[at] = level[at];
        ceiling[at] = level[at] + CEILING * relief[at];
        below[at] = downstream(&table, centre[0][0], at, &length[at]);
    }
    for (int64_t k = 0; k < vertices; k++) {
        int64_t at = order[k], to = below[at];
        if (to >= 0) {
            upstream[to] = least_index(upstream[to] + upstream[at], trunk);
            ceiling[to] = least(ceiling[to], greatest(ceiling[at] - step, level[to]));
        }
    }
    for (int64_t k = vertices - 1; k >= 0; k--) {
        int64_t at = order[k], to = below[at];
        if (to < 0 || upstream[at] >= trunk)
            continue;
        double area = (double)upstream[at] * (0.5 * (1 << (2 * SITE_BITS))), quarter = sqrt(sqrt(area));
        double slope = least(relief[at] * per_relief / (quarter * sqrt(quarter)), cap);
        double risen = least(height[to] + slope * metres * length[at], ceiling[at]);
        height[at] = greatest(risen, height[to] + 0.5 * step);
    }
}

/* The side of each vertex's lowest neighbour, -1 where none is lower. */
static void lowest_neighbours(
    const MeshTable *table, const double (*restrict height)[2], int64_t (*restrict receiver)[2])
{
    for (int64_t j = 0; j < table->rows; j++)
        for (int64_t i = 0; i < table->columns; i++)
            for (int64_t half = 0; half < 2; half++) {
                int64_t quad = j * table->columns + i;
                double lowest = height[quad][half];
                receiver[quad][half] = -1;
                for (int64_t k = 0; k < 3; k++) {
                    int64_t side = triangle_side(table, (Triangle){j, i, half}, k);
                    Triangle beyond = neighbour(table, (Triangle){j, i, half}, side);
                    if (beyond.row < 0)
                        continue;
                    double there = height[beyond.row * table->columns + beyond.column][beyond.half];
                    if (there < lowest) {
                        lowest = there;
                        receiver[quad][half] = side;
                    }
                }
            }
}

void captured_heights(
    int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const int64_t centre[restrict rows][columns][2][2], const double height[restrict rows][columns][2],
    const double relief[restrict rows][columns][2], const double site_relief[restrict rows + 1][columns + 1],
    double fall, double per_relief, double cap, double metres, int64_t captures,
    double lowered[restrict rows][columns][2], int64_t receiver[restrict rows][columns][2],
    double scratch[restrict rows][columns][2])
{
    static const int64_t ends[2][5][2] = {
        {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 2}}, {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {1, 3}}};
    const MeshTable table = {
        .rows = rows, .columns = columns, .diagonal = &diagonal[0][0], .relief = &relief[0][0][0],
        .site_relief = &site_relief[0][0]};
    const size_t bytes = sizeof(double) * 2 * (size_t)(rows * columns);
    memcpy(lowered, height, bytes);
    for (int64_t capture = 0; capture < captures; capture++) {
        memcpy(scratch, lowered, bytes);
        for (int64_t j = 0; j < rows; j++)
            for (int64_t i = 0; i < columns; i++)
                for (int64_t half = 0; half < 2; half++)
                    for (int64_t k = 0; k < 3; k++) {
                        int64_t side = triangle_side(&table, (Triangle){j, i, half}, k);
                        Triangle beyond = neighbour(&table, (Triangle){j, i, half}, side);
                        int64_t q = beyond.row, p = beyond.column, other = beyond.half;
                        if (q < 0)
                            continue;
                        const int64_t *corners = ends[diagonal[j][i]][side];
                        double beside =
                            edge_relief(&table, (Triangle){j, i, half}, beyond, corners[0], corners[1]);
                        double slope = least(CAPTURE_SLOPE * beside * per_relief, 2.0 * cap);
                        double dx = (double)(centre[q][p][other][0] - centre[j][i][half][0]);
                        double dy = (double)(centre[q][p][other][1] - centre[j][i][half][1]);
                        double rise = slope * metres * sqrt(dx * dx + dy * dy) + LEAST_FALL * fall;
                        lowered[j][i][half] = least(lowered[j][i][half], scratch[q][p][other] + rise);
                    }
    }
    lowest_neighbours(&table, lowered[0], receiver[0]);
}

void raised_heights(
    int64_t rows, int64_t columns, const int64_t diagonal[restrict rows][columns],
    const int64_t centre[restrict rows][columns][2][2], const double height[restrict 2 * rows * columns],
    const int64_t order[restrict 2 * rows * columns], const int64_t course[restrict rows][columns][2],
    double metres, double rise[restrict 2 * rows * columns], double raised[restrict 2 * rows * columns],
    int64_t receiver[restrict rows][columns][2], int64_t below[restrict 2 * rows * columns],
    double scratch[restrict 2 * rows * columns])
{
    const MeshTable table = {
        .rows = rows, .columns = columns, .diagonal = &diagonal[0][0], .receiver = &course[0][0][0]};
    const int64_t vertices = 2 * rows * columns;
    for (int64_t k = 0; k < vertices; k++) {
        int64_t at = order[k], to = downstream(&table, centre[0][0], at, &scratch[at]);
        below[at] = to;
        if (to >= 0)
            rise[to] = least(rise[to], rise[at] + KEPT_FALL * (height[at] - height[to]));
    }
    for (int64_t k = vertices - 1; k >= 0; k--) {
        int64_t at = order[k], to = below[at];
        if (to >= 0)
            rise[at] = least(rise[at], rise[to] + RISE_SLOPE * metres * scratch[at]);
        raised[at] = height[at] + rise[at];
    }
    lowest_neighbours(&table, (const double (*)[2])raised, receiver[0]);
}
