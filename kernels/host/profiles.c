#include "profiles.h"

static void sweep(
    int64_t nodes, const int64_t *starts, const int64_t *to, const double *most, const double *before,
    double *restrict after)
{
    for (int64_t i = 0; i < nodes; i++) {
        double total = 0.0;
        int64_t count = 0;
        for (int64_t k = starts[i]; k < starts[i + 1]; k++) {
            double apart = before[to[k]] - before[i];
            if (fabs(apart) > most[k]) {
                total += apart > most[k] ? apart - most[k] : apart + most[k];
                count++;
            }
        }
        after[i] = before[i] + (count ? 0.5 * total / (double)count : 0.0);
    }
}

void share_excess(
    int64_t nodes, int64_t edges, const int64_t starts[restrict nodes + 1], const int64_t to[restrict edges],
    const double most[restrict edges], double height[restrict nodes], double scratch[restrict nodes])
{
    for (int64_t pair = 0; pair < 100; pair++) {
        sweep(nodes, starts, to, most, height, scratch);
        sweep(nodes, starts, to, most, scratch, height);
    }
}

void least_squares(
    int64_t legs, int64_t stations, int64_t knots, const int64_t first[restrict legs + 1],
    const double ground[restrict stations], const double share[restrict stations],
    const double most[restrict stations - 1], const double ends[restrict legs][2],
    double found[restrict stations], double scratch[restrict 4][knots])
{
    const double wall = 1e9; /* slope of the derivative where there is no height */
    double *place[2] = {scratch[0], scratch[1]}, *jump[2] = {scratch[2], scratch[3]};
    for (int64_t i = 0; i < stations; i++)
        found[i] = ground[i];
    for (int64_t leg = 0; leg < legs; leg++) {
        int64_t start = first[leg], last = first[leg + 1] - 1, size[2] = {1, 1};
        double offset[2] = {0.0, 0.0}, near[2] = {0.0, 0.0}; /* slopes just below and above the minimum */
        double middle = ends[leg][0];
        place[0][0] = place[1][0] = middle;
        jump[0][0] = jump[1][0] = wall;
        for (int64_t i = start + 1; i < last; i++) {
            double r = most[i - 1], w = share[i], low = middle - r, high = middle + r;
            for (int64_t side = 0; side < 2; side++) {
                double move = side ? r : -r;
                offset[side] += move;
                place[side][size[side]] = middle + move - offset[side];
                jump[side][size[side]++] = near[side];
            }
            double aim = ground[i], slope = w > 0.0 ? w : 0.0; /* without a weight the flat part stays */
            if (w > 0.0 && low <= aim && aim <= high) {
                middle = aim;
            } else if (w > 0.0) {
                /* From the flat part's end to where the derivative w (z - aim) + ... is 0. */
                int64_t side = aim > high, other = 1 - side;
                double sign = side ? 1.0 : -1.0, at = side ? high : low, value = sign * w * (at - aim);
                for (;;) {
                    /* The knot at `at` is the top of this side's stack: it goes to the other one. */
                    double edge = jump[side][--size[side]];
                    place[other][size[other]] = at - offset[other];
                    jump[other][size[other]++] = -edge;
                    slope += edge;
                    middle = at - sign * value / slope;
                    if (size[side] == 0)
                        break;
                    double following = place[side][size[side] - 1] + offset[side];
                    if (!(sign * (middle - following) > 0.0))
                        break;
                    value += slope * sign * (following - at);
                    at = following;
                }
            }
            near[0] = near[1] = slope;
            found[i] = middle;
        }
        found[start] = ends[leg][0];
        found[last] = ends[leg][1];
        for (int64_t i = last - 1; i > start; i--)
            found[i] = least(greatest(found[i], found[i + 1] - most[i]), found[i + 1] + most[i]);
    }
}

void lower_envelope(
    int64_t nodes, int64_t edges, const int64_t values[restrict nodes],
    const int64_t starts[restrict nodes + 1], const int64_t to[restrict edges],
    const int64_t weight[restrict edges], int64_t free, int64_t found[restrict nodes],
    int64_t queue[restrict nodes], bool waiting[restrict nodes])
{
    int64_t head = 0, size = 0;
    for (int64_t i = 0; i < nodes; i++) {
        found[i] = values[i];
        waiting[i] = values[i] < free;
        if (waiting[i])
            queue[size++] = i;
    }
    while (size > 0) {
        int64_t here = queue[head];
        head = (head + 1) % nodes;
        size--;
        waiting[here] = false;
        for (int64_t k = starts[here]; k < starts[here + 1]; k++) {
            int64_t node = to[k], other = found[here] + weight[k];
            if (other >= found[node])
                continue;
            found[node] = other;
            if (!waiting[node]) {
                waiting[node] = true;
                queue[(head + size++) % nodes] = node;
            }
        }
    }
}

void mean_heights(
    int64_t legs, int64_t stations, const double along[restrict stations],
    const int64_t first[restrict legs + 1], const double height[restrict stations],
    const double reach[restrict stations], double found[restrict stations],
    double integral[restrict stations])
{
    for (int64_t i = 0; i < stations; i++)
        found[i] = height[i];
    for (int64_t leg = 0; leg < legs; leg++) {
        int64_t start = first[leg], last = first[leg + 1] - 1, side[2] = {start, start}; /* right, left */
        integral[start] = 0.0;
        for (int64_t i = start; i < last; i++)
            integral[i + 1] = integral[i] + 0.5 * (along[i + 1] - along[i]) * (height[i] + height[i + 1]);
        for (int64_t i = start; i <= last; i++) {
            double half = 0.5 * reach[i], total = 0.0;
            if (half < 1e-3)
                continue;
            for (int64_t s = 0; s < 2; s++) {
                double sign = s ? -1.0 : 1.0, at = along[i] + sign * half;
                while (side[s] < last - 1 && along[side[s] + 1] <= at)
                    side[s]++;
                int64_t k = side[s];
                double x = at - along[k], rise = (height[k + 1] - height[k]) / (along[k + 1] - along[k]);
                total += sign * (integral[k] + x * (height[k] + 0.5 * x * rise));
            }
            found[i] = total / (2.0 * half);
        }
    }
}

void united_reaches(
    int64_t legs, int64_t stations, const double along[restrict stations],
    const int64_t first[restrict legs + 1], const double reach[restrict stations],
    double found[restrict stations])
{
    double most = 0.0;
    for (int64_t i = 0; i < stations; i++) {
        found[i] = reach[i];
        most = greatest(most, reach[i]);
    }
    for (int64_t leg = 0; leg < legs; leg++)
        for (int64_t i = first[leg]; i < first[leg + 1]; i++) {
            double square = 0.0;
            for (int64_t step = -1; step < 2; step += 2)
                for (int64_t j = i + step; j >= first[leg] && j < first[leg + 1]; j += step) {
                    double way = along[j] - along[i], apart = 0.75 * (way * way);
                    if (apart > most * most)
                        break;
                    square = greatest(square, reach[j] * reach[j] - apart);
                }
            found[i] = greatest(reach[i], sqrt(square));
        }
}
