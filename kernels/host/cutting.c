#include "cutting.h"

#include <string.h>

enum { MOST = 16 };

static const double ANGLE = 1e-9; /* least squared length of the sum of two directions that have a bisector */

/* Clip a convex polygon to a x + b y <= c; return the number of corners. */
static int64_t clip_polygon(
    const double (*polygon)[2], int64_t count, double a, double b, double c, double (*result)[2])
{
    int64_t kept = 0;
    for (int64_t k = 0; k < count; k++) {
        int64_t next = k + 1 < count ? k + 1 : 0;
        double x = polygon[k][0], y = polygon[k][1], p = polygon[next][0], q = polygon[next][1];
        double here = a * x + b * y - c, there = a * p + b * q - c;
        if (here <= 0.0) {
            result[kept][0] = x;
            result[kept++][1] = y;
        }
        if ((here < 0.0 && 0.0 < there) || (there < 0.0 && 0.0 < here)) {
            double share = here / (here - there);
            result[kept][0] = x + share * (p - x);
            result[kept++][1] = y + share * (q - y);
        }
    }
    return kept;
}

void stroke_pieces(
    int64_t points, int64_t lines, int64_t segments, const double point[restrict points][2],
    const int64_t first[restrict lines + 1], const double reach[restrict lines],
    const int64_t owner[restrict segments], const int64_t place[restrict segments],
    double corners[restrict segments][16][2], int64_t count[restrict segments],
    double frame[restrict segments][4], double length[restrict segments], double along[restrict segments])
{
    static const double sides[4][2] = {{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}};
    double buffer[MOST][2];
    memset(corners, 0, (size_t)segments * sizeof *corners);
    for (int64_t k = 0; k < segments; k++) {
        int64_t begin = first[owner[k]], end = first[owner[k] + 1];
        int64_t at = begin + place[k], to = least_index(at + 1, end - 1);
        const double wide = reach[owner[k]];
        double x = point[at][0], y = point[at][1], dx = point[to][0] - x, dy = point[to][1] - y;
        double far = hypot(dx, dy), u = far > 0.0 ? dx / far : 1.0, v = far > 0.0 ? dy / far : 0.0;
        for (int c = 0; c < 4; c++) {
            double forward = sides[c][0] > 0.0 ? far + wide : -wide, t = sides[c][1];
            corners[k][c][0] = x + forward * u - t * wide * v;
            corners[k][c][1] = y + forward * v + t * wide * u;
        }
        count[k] = 4;
        memcpy(frame[k], (double[4]){x, y, u, v}, sizeof frame[k]);
        length[k] = far;
        along[k] = k > 0 && owner[k - 1] == owner[k] ? along[k - 1] + length[k - 1] : 0.0;
        for (int side = 0; side < 2 && far != 0.0; side++) { /* the segments before and after */
            int64_t other = side ? to + 1 : at - 1;
            double sign = side ? 1.0 : -1.0;
            if (other < begin || other >= end)
                continue;
            const double *corner = point[side ? to : at];
            double p = sign * (point[other][0] - corner[0]), q = sign * (point[other][1] - corner[1]);
            double away = hypot(p, q), a = u + p / away, b = v + q / away;
            if (a * a + b * b < ANGLE)
                continue;
            a *= sign;
            b *= sign;
            double c = a * corner[0] + b * corner[1];
            count[k] = clip_polygon((const double (*)[2])corners[k], count[k], a, b, c, buffer);
            memcpy(corners[k], buffer, (size_t)count[k] * sizeof *buffer);
        }
    }
}

/* Find the least and greatest value along an axis. */
static void range_of(const double (*polygon)[2], int64_t count, int axis, double *low, double *high)
{
    *low = *high = polygon[0][axis];
    for (int64_t k = 1; k < count; k++) {
        *low = least(*low, polygon[k][axis]);
        *high = greatest(*high, polygon[k][axis]);
    }
}

int64_t cells_met(
    int64_t polygons, int64_t most, int64_t room, const double polygon[restrict polygons][most][2],
    const int64_t count[restrict polygons], const double border[restrict polygons], int64_t side,
    int64_t found[restrict room], int64_t number[restrict room])
{
    double one[2 * MOST][2], two[2 * MOST][2], low, high;
    const double (*clipped)[2] = (const double (*)[2])two;
    int64_t met = 0;
    for (int64_t k = 0; k < polygons; k++) {
        double wide = border[k];
        if (count[k] < 3)
            continue;
        range_of(polygon[k], count[k], 1, &low, &high);
        int64_t end = (int64_t)least(floor(high + wide), (double)(side - 1));
        for (int64_t row = (int64_t)greatest(floor(low - wide), 0.0); row <= end; row++) {
            int64_t kept = clip_polygon(polygon[k], count[k], 0.0, -1.0, -((double)row - wide), one);
            kept = clip_polygon((const double (*)[2])one, kept, 0.0, 1.0, (double)row + 1.0 + wide, two);
            if (kept == 0)
                continue;
            double west, east;
            range_of(clipped, kept, 0, &west, &east);
            int64_t last = (int64_t)least(floor(east + wide), (double)(side - 1));
            for (int64_t column = (int64_t)greatest(floor(west - wide), 0.0); column <= last; column++, met++)
                if (met < room) {
                    found[met] = row * side + column;
                    number[met] = k;
                }
        }
    }
    return met;
}

int64_t cut_polygons(
    int64_t polygons, int64_t pairs, int64_t triangles, int64_t cells, int64_t listed, int64_t room,
    const double polygon[restrict polygons][16][2], const int64_t count[restrict polygons],
    const int64_t cell[restrict pairs], const int64_t owner[restrict pairs],
    const double corners[restrict triangles][3][2], const int64_t first[restrict cells],
    const int64_t met[restrict listed], int64_t stamp[restrict triangles], int64_t triangle[restrict room],
    int64_t part[restrict room], double column[restrict room], double row[restrict room])
{
    double buffers[2][2 * MOST][2];
    int64_t found = 0;
    for (int64_t t = 0; t < triangles; t++)
        stamp[t] = -1;
    for (int64_t n = 0; n < pairs; n++) {
        int64_t number = owner[n];
        for (int64_t m = first[cell[n]]; m < first[cell[n] + 1]; m++) {
            int64_t kept = count[number], t = met[m];
            if (stamp[t] == number)
                continue;
            stamp[t] = number;
            const double (*rest)[2] = polygon[number];
            for (int k = 0; k < 3; k++) {
                /* Counter-clockwise from above, and rows run southward. */
                const double *p = corners[t][k], *q = corners[t][k < 2 ? k + 1 : 0];
                double a = p[1] - q[1], b = q[0] - p[0];
                kept = clip_polygon(rest, kept, a, b, a * p[0] + b * p[1], buffers[k % 2]);
                rest = (const double (*)[2])buffers[k % 2];
            }
            for (int64_t fan = 1; fan < kept - 1; fan++)
                for (int64_t k = 0; k < 3; k++, found++)
                    if (found < room) {
                        const double *corner = rest[k == 0 ? 0 : fan + k - 1];
                        triangle[found] = t;
                        part[found] = number;
                        column[found] = corner[0];
                        row[found] = corner[1];
                    }
        }
    }
    return found;
}
