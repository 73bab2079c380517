#include "horizon.h"

enum { BEARINGS = 2048 }; /* a power of two: & is the remainder, rounded down */

void test_against_horizon(
    int64_t boxes, int64_t tests, int64_t tiles, int64_t raisers, const int64_t tested[restrict tests],
    const double limit[restrict boxes], const int64_t first[restrict boxes],
    const int64_t last[restrict boxes], const double most[restrict boxes],
    const int64_t raising[restrict raisers], const double far[restrict tiles],
    const int64_t ground_first[restrict tiles], const int64_t ground_last[restrict tiles],
    const double bottom[restrict tiles], bool hidden[restrict boxes], double horizon[restrict 2048])
{
    int64_t raised = 0;
    for (int64_t step = 0; step < BEARINGS; step++)
        horizon[step] = -INFINITY;
    for (int64_t k = 0; k < tests; k++) {
        int64_t box = tested[k];
        for (; raised < raisers && far[raising[raised]] <= limit[box]; raised++) {
            int64_t tile = raising[raised];
            for (int64_t step = ground_first[tile]; step < ground_last[tile]; step++) {
                double *at = &horizon[step & (BEARINGS - 1)];
                *at = greatest(*at, bottom[tile]);
            }
        }
        hidden[box] = true;
        for (int64_t step = first[box]; step < last[box] && hidden[box]; step++)
            hidden[box] = !(horizon[step & (BEARINGS - 1)] <= most[box]);
    }
}
