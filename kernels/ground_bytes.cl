// Patches side by side as files hold their ground: heights, and normals and material weights as bytes, each a plane
// of rows × columns vertices. Weights are rounded in 64 bits on every device, for the same bytes as on a host; so there
// is nothing here where there are none.
#include "real.clh"

#define NORMAL 3

// Whether a value is no number or infinite: by its bits, for compilers that may take all values for finite.
INLINE int is_odd(REAL x)
{
#ifdef cl_khr_fp64
    if (sizeof(REAL) == 8) return (as_int2((double)x).y & 0x7FF00000) == 0x7FF00000;
#endif
    return (as_int((float)x) & 0x7F800000) == 0x7F800000;
}

#ifdef cl_khr_fp64
// The sum in NumPy's order: up to 7 values one by one; else eight sums of every eighth, by pairs, then the others.
INLINE double sum_of(const double *x)
{
    const int eighths = MATERIALS / 8 * 8;
    double sum = 0.0;
    if (eighths > 0) {
        double part[8];
        for (int i = 0; i < eighths; ++i) part[i % 8] = i < 8 ? x[i] : part[i % 8] + x[i];
        sum = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
    }
    for (int i = eighths; i < MATERIALS; ++i) sum += x[i];
    return sum;
}

// Weights as bytes whose sum is 255, by the method of the largest remainder; the first of equal ones gets the step.
INLINE void weight_bytes(const REAL *weights, int *bytes)
{
    double exact[MATERIALS], rest[MATERIALS];
    for (int i = 0; i < MATERIALS; ++i) exact[i] = (double)weights[i];
    const double sum = sum_of(exact);
    const double scale = 255.0 / sum;  // correctly rounded: in 64 bits OpenCL asks for it
    int missing = 255;
    for (int i = 0; i < MATERIALS; ++i) {
        const double scaled = exact[i] * scale;
        const double whole = floor(scaled);
        rest[i] = scaled - whole;
        bytes[i] = (int)whole;
        missing -= bytes[i];
    }
    for (; missing > 0; --missing) {
        double most = rest[0];
        for (int i = 1; i < MATERIALS; ++i) most = rest[i] > most ? rest[i] : most;
        int assigned = 0;
        for (int i = 0; i < MATERIALS; ++i) {
            const int gets = !assigned && rest[i] == most;
            bytes[i] += gets;
            rest[i] = gets ? -1.0 : rest[i];
            assigned |= gets;
        }
    }
}

//   first, across     index of the first patch, row after row, and patches in a row
//   rows, columns     vertices of a plane; patches share a row and a column of them, written by the first alone
//   ground, material  patches * side^2, as written by `surfaces`; side is that of the global size
//   height            rows * columns, m
//   normal            3 planes: east, north, up; 0 is −1, 255 is 1
//   weight            MATERIALS planes that sum to 255
//   nonfinite         counts NaN and Inf
// Global size: (side, side, patches).
__kernel void ground_bytes(int first, int across, int rows, int columns, __global const REAL *ground,
                           __global const REAL *material, __global REAL *height, __global uchar *normal,
                           __global uchar *weight, __global int *nonfinite)
{
    const int side = get_global_size(0);
    const int patch = first + (int)get_global_id(2);
    const int row = (patch / across) * (side - 1) + (int)get_global_id(1);
    const int column = (patch % across) * (side - 1) + (int)get_global_id(0);
    if (row >= rows || column >= columns) return;
    if ((get_global_id(1) == side - 1 && row < rows - 1) || (get_global_id(0) == side - 1 && column < columns - 1)) return;
    const size_t from = ((size_t)get_global_id(2) * side + get_global_id(1)) * side + get_global_id(0);
    const size_t plane = (size_t)rows * columns;
    const size_t at = (size_t)row * columns + column;
    const REAL4 here = vload4(from, ground);
    const REAL parts[NORMAL] = {here.x, here.y, here.z};
    REAL weights[MATERIALS];
    int bytes[MATERIALS];
    int wrong = is_odd(here.w);
    for (int i = 0; i < NORMAL; ++i) wrong += is_odd(parts[i]);
    for (int i = 0; i < MATERIALS; ++i) {
        weights[i] = material[from * MATERIALS + i];
        wrong += is_odd(weights[i]);
    }
    if (wrong) {
        atomic_add(nonfinite, wrong);
        return;
    }
    height[at] = here.w;
    for (int i = 0; i < NORMAL; ++i) normal[at + i * plane] = (uchar)(int)rint(parts[i] * R(127.5) + R(127.5));
    weight_bytes(weights, bytes);
    for (int i = 0; i < MATERIALS; ++i) weight[at + i * plane] = (uchar)bytes[i];
}
#endif
