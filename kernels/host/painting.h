/* What is painted: parts of draped features, listed by the blocks of a square's texels that they may cover;
 * texels of tiles and textures; the choice of labels.
 *
 * Lengths are in texels from the square's south-west corner, blocks are numbered by rows from the north-west.
 */
#pragma once

#include "host.h"

/* As in kernels/appearance.cl and drape.clh; tests compare. */
#define SIDE 192 /* texels along a square */
#define BLOCK 8 /* texels along a block */
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

/* Find how far lines are from a place, and how often each runs around it. */
HOST void lines_around(
    int64_t lines, int64_t points, const int64_t first[restrict lines], const int32_t count[restrict lines],
    const double point[restrict points][2], double x, double y, double distance[restrict lines],
    int64_t turns[restrict lines]);

/* Multiply the three channels of texels by their share, the fourth one: round(c s / 255), 0 ... 255. */
HOST void premultiply(
    int64_t texels, const uint8_t texel[restrict texels][4], uint8_t result[restrict texels][4]);

#define STEEPEST 0.999 /* largest length of a normal's horizontal part */

/* Encode a mipmap level of a material as bytes: sqrt(albedo) and height; 0.5 + 0.5 normal x and y, roughness
 * and openness. Roughness is that of a surface (Trowbridge-Reitz) whose slopes vary around their mean. */
HOST void encode_texels(
    int64_t texels, const float painted[restrict texels][4], /* linear albedo, height: 0 ... 1 */
    const float moments[restrict texels][5], /* slopes east, north, mean of their squares, alpha^2, openness */
    uint8_t colour[restrict texels][4], uint8_t relief[restrict texels][4]);

/* Choose labels in their order: those that neither overlap one placed before nor are near an equal one. */
HOST void choose_labels(
    int64_t candidates, int64_t labels, const int64_t order[restrict candidates],
    const double box[restrict labels][4], /* west, south, east, north: px */
    const int64_t label[restrict labels], /* equal for anchors of one label */
    const int8_t state[restrict labels], /* 2: shown already, 1: fades out there, 0: neither */
    int64_t most_shown,
    double margin, /* between a label that appears and others, px */
    double repeat, /* between the middles of equal labels, half of it once they are shown, px */
    bool chosen[restrict labels],
    int64_t placed[restrict candidates]); /* scratch */
