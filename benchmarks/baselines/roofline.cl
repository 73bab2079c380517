// What a device can do at most: write, and multiply and add as the terrain's kernels do, without contraction.
#include "real.clh"

#define REAL8 PASTE(REAL, 8)

__kernel void roof_write(__global REAL *out)
{
    const size_t i = get_global_id(0);  // an int could wrap for all that a compiler knows: no stores side by side
    out[i] = R((int)i & 1023);
}

#define NEXT(c) c = c * factor + R(1)
// Eight products and as many sums a round, none waiting for another of its round.
#define OPERATE(NUMBER)                                                                        \
    const size_t i = get_global_id(0);                                                         \
    NUMBER a = R(i), b = R(i + 1), c = R(i + 2), d = R(i + 3);                                 \
    NUMBER e = R(i + 4), f = R(i + 5), g = R(i + 6), h = R(i + 7);                             \
    for (int round = 0; round < rounds; ++round) {                                             \
        NEXT(a); NEXT(b); NEXT(c); NEXT(d); NEXT(e); NEXT(f); NEXT(g); NEXT(h);                \
    }                                                                                          \
    out[i] = a + b + c + d + e + f + g + h

// For drivers that run work items in vectors, and for those that do not: eight values an item.
__kernel void roof_operate(REAL factor, int rounds, __global REAL *out) { OPERATE(REAL); }
__kernel void roof_operate_eights(REAL factor, int rounds, __global REAL8 *out) { OPERATE(REAL8); }
