// What writing alone costs: as many bytes as there are, one after the other.
#include "real.clh"

// Global size: how many fours of values `out` has.
__kernel void bench_write(__global REAL4 *out)
{
    const size_t i = get_global_id(0);
    const REAL x = R((int)(i & 1023));
    out[i] = (REAL4)(x, x, x, x);
}
