/* Heights of roads along their legs and network: see sketchterrain/roads/profile.py.
 *
 * Leg k has the stations from first[k] on, node i of a graph the neighbours from to[starts[i]] on. Piece i is
 * between stations i and i + 1; those between legs count for nothing.
 */
#pragma once

#include "host.h"

/* Move heights of junctions in sweeps by half of their mean excess over the limits of their legs. */
HOST void share_excess(
    int64_t nodes, int64_t edges, const int64_t starts[restrict nodes + 1], const int64_t to[restrict edges],
    const double most[restrict edges], /* difference of height, m */
    double height[restrict nodes], /* m */
    double scratch[restrict nodes]);

/* Heights of legs with given ends, nearest to the ground within the limits of grade:
 * f(i + 1, z) = share (z - ground)^2 + min of f(i, z') over |z' - z| <= most.
 * Knots of the derivative are in two stacks, below and above the minimum, each with a common offset. */
HOST void least_squares(
    int64_t legs, int64_t stations, int64_t knots, const int64_t first[restrict legs + 1],
    const double ground[restrict stations], /* m */
    const double share[restrict stations], /* weight, m; 0 where the ground does not matter */
    const double most[restrict stations - 1], /* difference of height of pieces, m */
    const double ends[restrict legs][2], /* m */
    double found[restrict stations], /* m; that of the ground outside of legs */
    double scratch[restrict 4][knots]); /* twice the stations of a leg and 4 */

/* The greatest function up to some values that rises by at most a weight along each edge. */
HOST void lower_envelope(
    int64_t nodes, int64_t edges,
    const int64_t values[restrict nodes], /* units of height; from `free` on there is none */
    const int64_t starts[restrict nodes + 1], const int64_t to[restrict edges],
    const int64_t weight[restrict edges], int64_t free, int64_t found[restrict nodes],
    int64_t queue[restrict nodes], /* scratch: a ring */
    bool waiting[restrict nodes]); /* scratch */

/* Means of piecewise linear heights over half of a reach to both sides, at the stations of each leg. */
HOST void mean_heights(
    int64_t legs, int64_t stations,
    const double along[restrict stations], /* m */
    const int64_t first[restrict legs + 1],
    const double height[restrict stations], /* m */
    const double reach[restrict stations], /* m */
    double found[restrict stations], /* m */
    double integral[restrict stations]); /* scratch */

/* How far beside stations all discs of a reach around stations of their leg extend:
 * max of sqrt(reach'^2 - 3/4 apart^2), the part of the distance along a bend that is left inside of it. */
HOST void united_reaches(
    int64_t legs, int64_t stations,
    const double along[restrict stations], /* m */
    const int64_t first[restrict legs + 1],
    const double reach[restrict stations], /* m */
    double found[restrict stations]); /* m */
