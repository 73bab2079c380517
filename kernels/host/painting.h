/* Parts of draped features, listed by the blocks of a square's texels that they may cover.
 *
 * Lengths are in texels from the square's south-west corner, blocks are numbered by rows from the north-west.
 */
#pragma once

#include "host.h"

/* As in kernels/drape.cl and drape.clh; tests compare. */
#define SIDE 192 /* texels along a square */
#define DRAPE_BLOCK 8 /* texels along a block */
#define PIECE_STARTS 1
#define PIECE_ENDS 2
#define PIECE_JOINS 4
#define PIECE_CONTINUES 8
#define MITRE_LIMIT 4.0

/* As in sketchterrain/features/items.py. */
#define STROKE 0
#define FILL 1
#define BEFORE 4 /* the first point of a line is only for the join */
#define AFTER 8

/* List segments of strokes, edges of closed rings, and points; what does not fit is only counted. */
HOST void drape_pieces(
    int64_t items, int64_t points, int64_t most_pieces, int64_t most_pairs, const int8_t kind[restrict items],
    const int64_t first[restrict items + 1], /* of the points of each item */
    const double point[restrict points][2],
    const uint8_t ends[restrict items], /* bits: PIECE_STARTS, PIECE_ENDS, BEFORE, AFTER */
    const double reach[restrict items], /* around strokes and points */
    const bool is_mitred[restrict items],
    double piece[restrict most_pieces][8], /* DrapePiece, along from the item's start */
    int32_t item[restrict most_pieces], /* of each piece */
    int32_t pair[restrict most_pairs][3], /* block, item, piece; by items */
    int64_t count[restrict 2], /* of pieces and of pairs */
    double scratch[restrict points][2]);
