// Operations that every device must compute to the same bits; compute/arithmetic.py has the expected values.
#include "hash.clh"
#include "real.clh"

#define REALS 8
#define WHOLES 5
#define STEPS 32

// A chain of products and sums: one that is contracted, reordered or approximated changes the end.
INLINE REAL chain(REAL a, REAL b, REAL c)
{
    REAL x = a;
    REAL y = b;
    for (int step = 0; step < STEPS; ++step) {
        const REAL next = real_clamp(x * y + c * R(0.25) - x * x * R(0.125), R(-2), R(2));
        y = real_clamp(y * R(0.75) + next * next * c, R(-2), R(2));
        x = next;
    }
    return x + y;
}

//   a, b, c     count each, within [-2, 2]
//   positive    count, > 0
//   word        count whole numbers; place  count, within 2^47
//   real        REALS rows of count; whole  WHOLES rows of count
// Global size: count.
__kernel void self_test(__global const REAL *a, __global const REAL *b, __global const REAL *c,
                        __global const REAL *positive, __global const uint *word, __global const long *place,
                        int count, __global REAL *real, __global uint *whole)
{
    const int i = get_global_id(0);
    const REAL p = positive[i];
    const long far = place[i];
    const uint n = word[i];
    real[i] = a[i] * b[i] + c[i];
    real[count + i] = chain(a[i], b[i], c[i]);
    real[2 * count + i] = inverse_sqrt(p);
    real[3 * count + i] = square_root(p);
    real[4 * count + i] = reciprocal(p);
    real[5 * count + i] = cubic(p);
    real[6 * count + i] = smooth_rise(a[i], b[i], R(0.5));
    real[7 * count + i] = real_of(far);
    whole[i] = mixed(n);
    whole[count + i] = scrambled(n);
    whole[2 * count + i] = (uint)(far >> (n & 31));
    whole[3 * count + i] = (uint)(((ulong)mixed(n) * (ulong)(n >> 8)) >> 32);
    whole[4 * count + i] = (uint)(int)(a[i] * R(1e6));
}
