#include "painting.h"

#include "edges.h"

#define BLOCKS (SIDE / BLOCK)

typedef struct {
    int64_t most_pieces, most_pairs, pieces, pairs;
    double (*piece)[8];
    int32_t *item, (*pair)[3];
} Lists;

static void add_pair(Lists *lists, int64_t row, int64_t column, int64_t item, int64_t piece)
{
    if (lists->pairs < lists->most_pairs) {
        int32_t *pair = lists->pair[lists->pairs];
        pair[0] = (int32_t)((BLOCKS - 1 - row) * BLOCKS + column);
        pair[1] = (int32_t)item;
        pair[2] = (int32_t)piece;
    }
    lists->pairs++;
}

static void add_piece(Lists *lists, int64_t item, const double piece[8])
{
    if (lists->pieces < lists->most_pieces) {
        for (int64_t c = 0; c < 8; c++)
            lists->piece[lists->pieces][c] = piece[c];
        lists->item[lists->pieces] = (int32_t)item;
    }
    lists->pieces++;
}

/* First and last block of an interval; the last one is before the first where none is. */
static int64_t first_block(double low) { return bounded_floor(low / BLOCK, 0, BLOCKS); }
static int64_t last_block(double high) { return bounded_floor(high / BLOCK, -1, BLOCKS - 1); }

/* List a segment or point in all blocks that it may cover a part of. */
static void list_segment(Lists *lists, int64_t item, double reach, const double piece[8])
{
    double x = piece[0], y = piece[1], east = piece[2], north = piece[3];
    reach += 0.75; /* from the middle of a texel to its corner, about */
    double west = least(x, x + east) - reach, east_end = greatest(x, x + east) + reach;
    double south = least(y, y + north) - reach, north_end = greatest(y, y + north) + reach;
    if (east_end < 0.0 || north_end < 0.0 || west > SIDE || south > SIDE)
        return;
    double square = east * east + north * north, far = reach + BLOCK * sqrt(0.5);
    int64_t before = lists->pairs, first = first_block(west), last = last_block(east_end);
    for (int64_t j = first_block(south); j <= last_block(north_end); j++) {
        double dy = ((double)j + 0.5) * BLOCK - y, apart[BLOCKS];
        for (int64_t k = first; k <= last; k++) {
            double dx = ((double)k + 0.5) * BLOCK - x, t = (dx * east + dy * north) / square;
            t = square > 0.0 ? least(greatest(t, 0.0), 1.0) : 0.0;
            apart[k] = (dx - t * east) * (dx - t * east) + (dy - t * north) * (dy - t * north);
        }
        for (int64_t k = first; k <= last; k++)
            if (apart[k] <= far * far)
                add_pair(lists, j, k, item, lists->pieces);
    }
    if (lists->pairs > before)
        add_piece(lists, item, piece);
}

/* List the segments of a run of a line, without points that repeat the one before. */
static void list_stroke(
    Lists *lists, int64_t item, int64_t points, const double point[][2], int64_t ends, double reach,
    bool is_mitred, double line[][2])
{
    const double longest = 512.0; /* longer segments are cut, so that their ends are near */
    int64_t count = 0, begin = 0, stop = 0;
    for (int64_t k = 0; k < points; k++) {
        if (count == 0 || hypot(point[k][0] - line[count - 1][0], point[k][1] - line[count - 1][1]) > 1e-9) {
            line[count][0] = point[k][0];
            line[count++][1] = point[k][1];
        }
        if (k == 1 && ends & BEFORE)
            begin = count - 1;
        if (k < points - 1 || !(ends & AFTER))
            stop = count - 1;
    }
    double along = 0.0;
    for (int64_t k = begin; k < stop; k++) {
        double start[2] = {line[k][0], line[k][1]};
        double way[2] = {line[k + 1][0] - start[0], line[k + 1][1] - start[1]};
        double length = hypot(way[0], way[1]), from[2] = {0.0, 0.0}, most = reach, low = 0.0, high = 1.0;
        int64_t bits = (k == begin ? ends & PIECE_STARTS : 0) | (k == stop - 1 ? ends & PIECE_ENDS : 0);
        bits |= k + 2 < count ? PIECE_CONTINUES : 0;
        if (k > 0) {
            bits |= PIECE_JOINS;
            from[0] = start[0] - line[k - 1][0];
            from[1] = start[1] - line[k - 1][1];
            double whole = hypot(from[0], from[1]);
            from[0] /= whole;
            from[1] /= whole;
            double half = sqrt(greatest(0.5 + 0.5 * (from[0] * way[0] + from[1] * way[1]) / length, 0.0));
            if (is_mitred && half * MITRE_LIMIT >= 1.0)
                most = reach / half;
        }
        if (length > longest) {
            for (int64_t c = 0; c < 2; c++)
                if (way[c] != 0.0) {
                    double a = (-most - longest - start[c]) / way[c];
                    double b = (SIDE + most + longest - start[c]) / way[c];
                    low = greatest(low, least(a, b));
                    high = least(high, greatest(a, b));
                }
            bits &= low > 0.0 ? ~(PIECE_STARTS | PIECE_JOINS) : -1;
            bits &= high < 1.0 ? ~(PIECE_ENDS | PIECE_CONTINUES) : -1;
        }
        if (low < high) {
            double part = high - low;
            list_segment(lists, item, most, (double[8]){
                start[0] + low * way[0], start[1] + low * way[1], part * way[0], part * way[1],
                along + low * length, (double)bits, from[0], from[1]});
        }
        along += length;
    }
}

/* List the edges of a ring in the blocks that they are in, and what is inside at the blocks' corners.
 *
 * The part of an edge beyond a block's western side counts in all of its rows east of it. An upright edge
 * along that side, from there to the block's northern side, makes up for it: then nothing else west of the
 * block matters but the winding number of its south-western corner. */
static void list_ring(Lists *lists, int64_t item, int64_t points, const double point[][2])
{
    int64_t turns[BLOCKS][BLOCKS + 1] = {{0}}; /* what is added to a corner and those east of it */
    for (int64_t k = 0; k < points - 1; k++) {
        bool runs_north = point[k][1] <= point[k + 1][1];
        const double *from = point[runs_north ? k : k + 1], *to = point[runs_north ? k + 1 : k];
        double x = from[0], y = from[1], to_x = to[0], top = to[1];
        if (top < 0.0 || y > SIDE)
            continue;
        double slope = top > y ? (to_x - x) / (top - y) : 0.0;
        int64_t edge = -1;
        for (int64_t j = first_block(y); j <= last_block(top); j++) {
            double south = (double)(j * BLOCK), end = south + BLOCK;
            double low = greatest(y, south), high = least(top, end);
            double at = low == y ? x : x + (low - y) * slope;
            double until = high == top ? to_x : x + (high - y) * slope;
            if (y <= south && south < top)
                turns[j][last_block(at) + 1] += runs_north ? -1 : 1;
            if (low >= high && !(y == top && south < y && y < end))
                continue;
            for (int64_t c = first_block(least(at, until)); c <= last_block(greatest(at, until)); c++) {
                if (edge < 0) {
                    edge = lists->pieces;
                    /* Far ends would cost precision. */
                    double bottom = greatest(y, -1.0), above = least(top, SIDE + 1.0);
                    double a = x + (bottom - y) * slope, b = above == top ? to_x : x + (above - y) * slope;
                    if (runs_north)
                        add_piece(lists, item, (double[8]){a, bottom, b - a, above - bottom});
                    else
                        add_piece(lists, item, (double[8]){b, above, a - b, bottom - above});
                }
                add_pair(lists, j, c, item, edge);
                double west = (double)(c * BLOCK);
                if ((at < west) == (until < west))
                    continue;
                double height = at < west ? low : high, rise = end - height;
                bool begins_there = (at < west) == runs_north;
                add_pair(lists, j, c, item, lists->pieces);
                add_piece(lists, item, (double[8]){
                    west, begins_there ? height + rise : height, 0.0, begins_there ? -rise : rise});
            }
        }
    }
    for (int64_t j = 0; j < BLOCKS; j++)
        for (int64_t c = 0, winding = 0; c < BLOCKS; c++) {
            winding += turns[j][c];
            for (int64_t n = winding < 0 ? -winding : winding; n > 0; n--)
                add_pair(lists, j, c, item, winding < 0);
        }
}

void drape_pieces(
    int64_t items, int64_t points, int64_t most_pieces, int64_t most_pairs, const int8_t kind[restrict items],
    const int64_t first[restrict items + 1], const double point[restrict points][2],
    const uint8_t ends[restrict items], const double reach[restrict items],
    const bool is_mitred[restrict items], double piece[restrict most_pieces][8],
    int32_t item[restrict most_pieces], int32_t pair[restrict most_pairs][3], int64_t count[restrict 2],
    double scratch[restrict points][2])
{
    Lists lists = {most_pieces, most_pairs, 0, 0, piece, item, pair};
    /* Edges west of all blocks, of areas that a block lies in and of holes. */
    add_piece(&lists, 0, (double[8]){0.0, SIDE, 0.0, -SIDE});
    add_piece(&lists, 0, (double[8]){0.0, 0.0, 0.0, SIDE});
    for (int64_t i = 0; i < items; i++) {
        const double(*own)[2] = point + first[i];
        int64_t own_points = first[i + 1] - first[i];
        if (kind[i] == FILL)
            list_ring(&lists, i, own_points, own);
        else if (kind[i] == STROKE)
            list_stroke(&lists, i, own_points, own, ends[i], reach[i], is_mitred[i], scratch);
        else
            list_segment(&lists, i, reach[i], (double[8]){own[0][0], own[0][1]});
    }
    count[0] = lists.pieces;
    count[1] = lists.pairs;
}

void premultiply(int64_t texels, const uint8_t texel[restrict texels][4], uint8_t result[restrict texels][4])
{
    for (int64_t n = 0; n < texels; n++)
        for (int c = 0; c < 4; c++) {
            uint32_t share = c < 3 ? texel[n][3] : 255;
            result[n][c] = (uint8_t)((texel[n][c] * share + 127) / 255);
        }
}

static inline float clamped(float x) { return x < 0.0f ? 0.0f : x > 1.0f ? 1.0f : x; }

void encode_texels(
    int64_t texels, const float painted[restrict texels][4], const float moments[restrict texels][5],
    uint8_t colour[restrict texels][4], uint8_t relief[restrict texels][4])
{
    const float most = (float)STEEPEST;
    for (int64_t n = 0; n < texels; n++) {
        const float *p = painted[n], *m = moments[n];
        float east = m[0] * m[0], north = m[1] * m[1], variance = m[2] - 0.5f * (east + north);
        float shorter = 1.0f / sqrtf(1.0f + east + north), x = -m[0] * shorter, y = -m[1] * shorter;
        float length = sqrtf(x * x + y * y), less = length > most ? most / length : 1.0f;
        float alpha2 = m[3] + 2.0f * (variance > 0.0f ? variance : 0.0f);
        const float found[8] = {
            sqrtf(clamped(p[0])), sqrtf(clamped(p[1])), sqrtf(clamped(p[2])), p[3], 0.5f + 0.5f * (x * less),
            0.5f + 0.5f * (y * less), sqrtf(sqrtf(clamped(alpha2))), m[4]};
        for (int c = 0; c < 8; c++)
            (c < 4 ? colour : relief)[n][c % 4] = (uint8_t)rintf(clamped(found[c]) * 255.0f);
    }
}

void lines_around(
    int64_t lines, int64_t points, const int64_t first[restrict lines], const int32_t count[restrict lines],
    const double point[restrict points][2], double x, double y, double distance[restrict lines],
    int64_t turns[restrict lines])
{
    (void)points;
    for (int64_t n = 0; n < lines; n++) {
        const double(*at)[2] = point + first[n];
        double from_x = at[0][0] - x, from_y = at[0][1] - y, nearest = from_x * from_x + from_y * from_y;
        int64_t around = 0;
        for (int64_t k = 1; k < count[n]; k++) {
            double to_x = at[k][0] - x, to_y = at[k][1] - y, east = to_x - from_x, north = to_y - from_y;
            double t = -(from_x * east + from_y * north) / greatest(east * east + north * north, 1e-12);
            t = least(greatest(t, 0.0), 1.0);
            double across = from_x + t * east, up = from_y + t * north, side = from_x * to_y - from_y * to_x;
            nearest = least(nearest, across * across + up * up);
            nearest = least(nearest, to_x * to_x + to_y * to_y);
            around += (from_y <= 0.0 && to_y > 0.0 && side > 0.0) - (from_y > 0.0 && to_y <= 0.0 && side < 0.0);
            from_x = to_x;
            from_y = to_y;
        }
        distance[n] = sqrt(nearest);
        turns[n] = around;
    }
}

void choose_labels(
    int64_t candidates, int64_t labels, const int64_t order[restrict candidates],
    const double box[restrict labels][4], const int64_t label[restrict labels],
    const int8_t state[restrict labels], int64_t most_shown, double margin, double repeat,
    bool chosen[restrict labels], int64_t placed[restrict candidates])
{
    int64_t count = 0, shown = 0;
    for (int64_t i = 0; i < labels; i++)
        chosen[i] = false;
    for (int64_t n = 0; n < candidates; n++) {
        int64_t i = order[n];
        bool fades = state[i] == 1, appears = state[i] == 0, is_free = true;
        if (!fades && shown == most_shown)
            continue;
        const double *a = box[i], room = appears ? margin : 0.0, reach = appears ? repeat : 0.5 * repeat;
        for (int64_t k = 0; k < count && is_free && !fades; k++) {
            const double *b = box[placed[k]];
            double apart = greatest(greatest(a[0] - b[2], b[0] - a[2]), a[1] - b[3]);
            apart = greatest(apart, b[1] - a[3]);
            double between = 0.5 * greatest(fabs(a[0] + a[2] - b[0] - b[2]), fabs(a[1] + a[3] - b[1] - b[3]));
            is_free = !(apart < room || (label[i] == label[placed[k]] && between < reach));
        }
        if (!is_free)
            continue;
        placed[count++] = i;
        chosen[i] = !fades;
        shown += !fades;
    }
}
