// Distances from points to splines by every method: for the benchmark, and for the tests that drive them to failure.
#include "spline_arcs.clh"
#include "baselines/spline_newton.clh"
#include "baselines/spline_roots.clh"
#include "baselines/spline_sampling.clh"
#include "baselines/spline_two_step.clh"

// Point i asks about spline i / points_each; all splines have as many pieces. Every kernel gives metres.
#define CURVE_ARGUMENTS                                                                                                \
    __global const REAL4 *cubic, int pieces, __global const REAL2 *point, int points_each, __global REAL *distance
#define CURVE_DISTANCE(method)                                                                                         \
    {                                                                                                                  \
        const int i = get_global_id(0);                                                                                \
        const Curve curve = {cubic + 2 * pieces * (i / points_each), pieces};                                          \
        distance[i] = square_root(method(curve, point[i].s0, point[i].s1).square);                                     \
    }

__kernel void spline_newton_distances(CURVE_ARGUMENTS) CURVE_DISTANCE(spline_newton)
__kernel void spline_two_step_distances(CURVE_ARGUMENTS) CURVE_DISTANCE(spline_two_step)
__kernel void spline_sampling_distances(CURVE_ARGUMENTS) CURVE_DISTANCE(spline_sampling)
__kernel void spline_roots_distances(CURVE_ARGUMENTS) CURVE_DISTANCE(spline_roots)

// Flattened splines: pieces starts[k] … starts[k + 1] are those of spline k.
//   start  REAL2: where a piece begins (m)
//   chord  REAL4: vector to its end (m, m), 1/length^2, bend (see spline_arcs.clh)
__kernel void spline_arcs_distances(__global const int *starts, __global const REAL2 *start,
                                    __global const REAL4 *chord, __global const REAL2 *point, int points_each,
                                    __global REAL *distance)
{
    const int i = get_global_id(0);
    const int spline = i / points_each;
    REAL nearest = R(1e30);
    for (int k = starts[spline]; k < starts[spline + 1]; ++k) {
        const REAL4 c = chord[k];
        const REAL east = point[i].s0 - start[k].s0;
        const REAL north = point[i].s1 - start[k].s1;
        nearest = real_min(nearest, nearest_on_arc(c, c.s3, east, north).square);
    }
    distance[i] = square_root(nearest);
}

// The same where all bends are 0.
__kernel void spline_segments_distances(__global const int *starts, __global const REAL2 *start,
                                        __global const REAL4 *chord, __global const REAL2 *point,
                                        int points_each, __global REAL *distance)
{
    const int i = get_global_id(0);
    const int spline = i / points_each;
    REAL nearest = R(1e30);
    for (int k = starts[spline]; k < starts[spline + 1]; ++k) {
        const REAL4 c = chord[k];
        const REAL east = point[i].s0 - start[k].s0;
        const REAL north = point[i].s1 - start[k].s1;
        const REAL t = real_clamp((east * c.s0 + north * c.s1) * c.s2, R(0), R(1));
        const REAL ex = east - t * c.s0;
        const REAL ey = north - t * c.s1;
        nearest = real_min(nearest, ex * ex + ey * ey);
    }
    distance[i] = square_root(nearest);
}
