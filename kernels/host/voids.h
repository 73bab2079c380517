/* Small voids of a DEM, filled by a membrane: Laplace's equation with the samples around them as the border.
 *
 * Successive over-relaxation, h += r (mean of the four neighbours - h), with r = 2 / (1 + sin(pi / n)):
 * Young, "Iterative methods for solving partial difference equations of elliptic type" (1954).
 */
#pragma once

#include "host.h"

/* Fill some of the voids in place, each from the samples beside it alone: first all with their mean, then
 * relaxed until no sample moves by 0.1 mm. Voids touch neither the border nor, by a corner, each other. */
HOST void fill_voids(
    int64_t rows, int64_t columns, int64_t voids, int64_t chosen, int64_t largest,
    float samples[restrict rows][columns], /* m */
    const int32_t labels[restrict rows][columns], /* number of the void, from 1 on */
    const int64_t boxes[restrict voids][4], /* first and last row + 1, first and last column + 1 */
    const int64_t which[restrict chosen], /* numbers of voids, from 0 on */
    const double relaxation[restrict chosen], /* r, 1 ... 2 */
    double window[restrict largest], /* scratch: samples of a box and one more on each side */
    int64_t inner[restrict largest]); /* scratch */
