#include "voids.h"

static const int64_t MOST_ROUNDS = 2000;
static const double CLOSE = 1e-4; /* m */

/* Relax the inner samples of a window, ascending, until they rest. */
static void relax(
    double *height, int64_t columns, const int64_t *inner, int64_t count, double relaxation)
{
    for (int64_t round = 0; round < MOST_ROUNDS; round++) {
        double most = 0.0;
        for (int64_t k = 0; k < count; k++) {
            double *at = height + inner[k];
            double around = at[1] + at[-1] + at[columns] + at[-columns];
            double change = relaxation * (0.25 * around - *at);
            *at += change;
            most = greatest(most, fabs(change));
        }
        if (most < CLOSE)
            break;
    }
}

void fill_voids(
    int64_t rows, int64_t columns, int64_t voids, int64_t chosen, int64_t largest,
    float samples[restrict rows][columns], const int32_t labels[restrict rows][columns],
    const int64_t boxes[restrict voids][4], const int64_t which[restrict chosen],
    const double relaxation[restrict chosen], double window[restrict largest],
    int64_t inner[restrict largest])
{
    for (int64_t k = 0; k < chosen; k++) {
        const int64_t *box = boxes[which[k]], label = which[k] + 1;
        int64_t top = box[0] - 1, left = box[2] - 1, height = box[1] + 1 - top, width = box[3] + 1 - left;
        int64_t count = 0, beside = 0;
        double total = 0.0;
        for (int64_t r = 0; r < height; r++)
            for (int64_t c = 0; c < width; c++) {
                window[r * width + c] = (double)samples[top + r][left + c];
                if (labels[top + r][left + c] != label)
                    continue;
                inner[count++] = r * width + c;
                for (int64_t p = top + r - 1; p < top + r + 2; p++)
                    for (int64_t q = left + c - 1; q < left + c + 2; q++)
                        if (labels[p][q] != label) {
                            total += samples[p][q];
                            beside++;
                        }
            }
        for (int64_t n = 0; n < count; n++)
            window[inner[n]] = total / beside;
        relax(window, width, inner, count, relaxation[k]);
        for (int64_t n = 0; n < count; n++)
            samples[top + inner[n] / width][left + inner[n] % width] = (float)window[inner[n]];
    }
}
