#include "tops.h"

#include <string.h>

enum { MOST_PIECES = 512, MOST_CORNERS = 20 };

static const double SLIVER = 1e-6; /* of the growth */

typedef double Polygon[MOST_CORNERS][2];

typedef struct {
    const double (*boxes)[4], *growth;
    const int64_t *first;
    const double (*corners)[4][2];
} Kernels;

/* What is left of a kernel: pieces are cut from one side to the other. */
typedef struct {
    Polygon (*pieces)[MOST_PIECES];
    int64_t (*sizes)[MOST_PIECES];
} Remains;

static inline double distance_to(const double line[3], const double point[2])
{
    return line[0] * point[0] + line[1] * point[1] + line[2];
}

/* Write a, b, c of the edges of a rectangle, grown by some metres: distance outward = a x + b y + c. */
static void edges_of(const double corners[4][2], double grow, double lines[4][3])
{
    for (int i = 0; i < 4; i++) {
        double x = corners[i][0], y = corners[i][1];
        double dx = corners[(i + 1) % 4][0] - x, dy = corners[(i + 1) % 4][1] - y;
        double length = hypot(dx, dy);
        lines[i][0] = dy / length;
        lines[i][1] = -dx / length;
        lines[i][2] = -(lines[i][0] * x + lines[i][1] * y) - grow;
    }
}

static bool is_apart(double lines[4][3], const double (*piece)[2], int64_t size, double sliver)
{
    for (int i = 0; i < 4; i++) {
        int64_t j = 0;
        while (j < size && !(distance_to(lines[i], piece[j]) < -sliver))
            j++;
        if (j == size)
            return true;
    }
    return false;
}

/* Write the pieces outside of a grown rectangle to the other side; return their number, -1 if too many. */
static int64_t without(const double corners[4][2], double grow, Remains *remains, int side, int64_t left)
{
    double lines[4][3], buffers[2][MOST_CORNERS][2];
    Polygon *pieces = remains->pieces[1 - side];
    int64_t *sizes = remains->sizes[1 - side], count = 0;
    const double sliver = SLIVER * grow;
    edges_of(corners, grow, lines);
    for (int64_t k = 0; k < left; k++) {
        int64_t size = remains->sizes[side][k];
        double (*rest)[2] = remains->pieces[side][k], (*kept)[2] = buffers[0];
        if (is_apart(lines, (const double (*)[2])rest, size, sliver)) {
            if (count == MOST_PIECES)
                return -1;
            memcpy(pieces[count], rest, (size_t)size * sizeof *rest);
            sizes[count++] = size;
            continue;
        }
        for (int i = 0; i < 4; i++) {
            if (count == MOST_PIECES || size + 1 > MOST_CORNERS)
                return -1;
            /* The part beyond this edge is left, the other one goes on to the next edge. */
            double (*beyond)[2] = pieces[count], most = 0.0;
            int64_t out = 0, in = 0;
            for (int64_t j = 0; j < size; j++) {
                const double *here = rest[j], *there = rest[j + 1 < size ? j + 1 : 0];
                double d = distance_to(lines[i], here), e = distance_to(lines[i], there);
                most = greatest(most, d);
                if (d >= 0.0) {
                    beyond[out][0] = here[0];
                    beyond[out++][1] = here[1];
                }
                if (d <= 0.0) {
                    kept[in][0] = here[0];
                    kept[in++][1] = here[1];
                }
                if ((d < 0.0 && e > 0.0) || (d > 0.0 && e < 0.0)) {
                    double t = d / (d - e);
                    for (int axis = 0; axis < 2; axis++)
                        beyond[out][axis] = kept[in][axis] = here[axis] + t * (there[axis] - here[axis]);
                    out++;
                    in++;
                }
            }
            if (most > sliver) {
                sizes[count++] = out;
                rest = kept;
                size = in;
                kept = kept == buffers[0] ? buffers[1] : buffers[0];
            }
            if (size < 3)
                break;
        }
    }
    return count;
}

/* Return the patch with which those of a heap, lowest first, cover the kernel of p; -1 if they do not. */
static int64_t covering(int64_t p, HeapEntry *heap, int64_t count, const Kernels *kernels, Remains *remains)
{
    int side = 0;
    int64_t left = kernels->first[p + 1] - kernels->first[p];
    for (int64_t k = 0; k < left; k++) {
        remains->sizes[0][k] = 4;
        memcpy(remains->pieces[0][k], kernels->corners[kernels->first[p] + k], sizeof *kernels->corners);
    }
    while (count > 0) {
        int64_t q = heap_pop(heap, &count).index;
        for (int64_t k = kernels->first[q]; k < kernels->first[q + 1]; k++) {
            left = without(kernels->corners[k], kernels->growth[q], remains, side, left);
            side = 1 - side;
            if (left <= 0)
                return left == 0 ? q : -1;
        }
    }
    return -1;
}

void compute_tops(
    int64_t asked, int64_t patches, int64_t rectangles, int64_t classes, int64_t cells, int64_t listed,
    const int64_t which[restrict asked], const int64_t rank[restrict patches],
    const double error[restrict patches], const bool finest[restrict patches],
    const int32_t grid[restrict patches], const double boxes[restrict patches][4],
    const double growth[restrict patches], const int64_t first[restrict patches + 1],
    const double corners[restrict rectangles][4][2], const double places[restrict classes][3],
    const int64_t shapes[restrict classes][3], const int64_t starts[restrict cells],
    const int64_t items[restrict listed], int64_t begin, int64_t end, double top[restrict asked],
    bool is_best[restrict asked], int64_t seen[restrict patches], int64_t near[restrict patches],
    double heap[restrict 2 * patches], double other_heap[restrict 2 * patches],
    double pieces[restrict 2][512][20][2], int64_t sizes[restrict 2][512])
{
    const Kernels kernels = {boxes, growth, first, corners};
    Remains remains = {pieces, sizes};
    HeapEntry *greater = (HeapEntry *)heap, *better = (HeapEntry *)other_heap;
    for (int64_t q = 0; q < patches; q++)
        seen[q] = -1;
    for (int64_t n = begin; n < end; n++) {
        int64_t p = which[n], count = 0, greaters = 0, betters = 0;
        const double *box = boxes[p];
        /* Patches whose grown kernels touch that of p, each once. */
        for (int64_t c = 0; c < classes; c++) {
            const double *place = places[c];
            int64_t wide = shapes[c][0];
            int64_t x0 = greatest_index((int64_t)floor((box[0] - place[0]) / place[2]), 0);
            int64_t x1 = least_index((int64_t)floor((box[2] - place[0]) / place[2]), wide - 1);
            int64_t y0 = greatest_index((int64_t)floor((box[1] - place[1]) / place[2]), 0);
            int64_t y1 = least_index((int64_t)floor((box[3] - place[1]) / place[2]), shapes[c][1] - 1);
            for (int64_t row = y0; row <= y1 && x0 <= x1; row++) {
                int64_t key = shapes[c][2] + row * wide;
                for (int64_t k = starts[key + x0]; k < starts[key + x1 + 1]; k++) {
                    int64_t q = items[k];
                    const double *other = boxes[q], g = growth[q];
                    bool touches = other[0] - g < box[2] && other[2] + g > box[0] && other[1] - g < box[3]
                        && other[3] + g > box[1];
                    if (q == p || seen[q] == p || !touches)
                        continue;
                    seen[q] = p;
                    near[count++] = q;
                }
            }
        }
        for (int64_t k = 0; k < count; k++) {
            int64_t q = near[k];
            bool before = error[q] < error[p] || (error[q] == error[p] && q < p);
            if (rank[q] > rank[p] || (rank[q] == rank[p] && before))
                heap_push(greater, &greaters, error[q], q);
            before = rank[q] > rank[p] || (rank[q] == rank[p] && q < p);
            if (finest[p] && finest[q] && grid[q] != grid[p]
                && (error[q] < error[p] || (error[q] == error[p] && before)))
                heap_push(better, &betters, 0.0, q);
        }
        /* Greater patches, by error, until they cover the kernel. */
        int64_t last = covering(p, greater, greaters, &kernels, &remains);
        top[n] = last < 0 ? INFINITY : error[last];
        /* What no other grid knows better is used whatever accuracy is asked. */
        is_best[n] = finest[p] && covering(p, better, betters, &kernels, &remains) < 0;
    }
}

void mark_kernels(
    int64_t patches, int64_t rectangles, int64_t rows, int64_t columns,
    const double boxes[restrict patches][4], const double grow[restrict patches],
    const int64_t first[restrict patches + 1], const double corners[restrict rectangles][4][2],
    double west, double south, double spacing, bool inside[restrict rows][columns])
{
    for (int64_t p = 0; p < patches; p++) {
        int64_t column0 = greatest_index((int64_t)ceil((boxes[p][0] - grow[p] - west) / spacing), 0);
        int64_t row0 = greatest_index((int64_t)ceil((boxes[p][1] - grow[p] - south) / spacing), 0);
        int64_t column1 = least_index((int64_t)floor((boxes[p][2] + grow[p] - west) / spacing) + 1, columns);
        int64_t row1 = least_index((int64_t)floor((boxes[p][3] + grow[p] - south) / spacing) + 1, rows);
        for (int64_t k = first[p]; k < first[p + 1]; k++) {
            double lines[4][3];
            edges_of(corners[k], grow[p], lines);
            for (int64_t row = row0; row < row1; row++)
                for (int64_t column = column0; column < column1; column++) {
                    double point[2] = {west + column * spacing, south + row * spacing};
                    bool is_inside = inside[row][column];
                    double most = distance_to(lines[0], point);
                    for (int i = 1; i < 4; i++)
                        most = greatest(most, distance_to(lines[i], point));
                    inside[row][column] = is_inside || most <= 0.0;
                }
        }
    }
}
