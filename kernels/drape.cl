// Draped layers over appearance tiles: strokes, areas, points and pictures, in their order.
#include "drape.clh"

#define SIDE 192       // texels along a tile, as in appearance.cl
#define DRAPE_BLOCK 8  // … along a group, for which entries are listed
#define DRAPE_BLOCKS (SIDE / DRAPE_BLOCK)
#define ENTRY_STROKE 0 // kinds of entries
#define ENTRY_FILL 1
#define ENTRY_POINT 2
#define ENTRY_PICTURE 3
#define DRAPE_RING R(0.7)  // of the radius of points, from where on they have the colour of outlines

//   starts    of each block, into entries, from the lowest to the highest
//   entry     int4: style, ENTRY_…, first in `list`, or the picture, and number of pieces: of one feature
//   list      numbers of pieces
//   anchor    REAL2 a style of a tile: place of the tile's corner in its hatch, if any style has one
//   base      uchar4 a texel of the tiles that have one, by `base_of`, -1: what lies below, in the form of the result
//   picture   uchar4 a texel: √ of red, green, blue, 1 for white, and opacity
//   result    uchar4 a texel: √ of red, green, blue, and the share
//   filtered  whether `filter`, uchar4 a texel, has what of the ground's red, green and blue is seen, and what is lit
__kernel void drape(__global const int *starts, __global const int4 *entry, __global const int *list,
                    __global const DrapePiece *piece, __global const REAL2 *anchor, __global const DrapeStyle *styles,
                    __global const int *base_of, __global const uchar4 *base, __global const uchar4 *picture,
                    int style_count, int filtered, __global uchar4 *result, __global uchar4 *filter)
{
    const int across = get_group_id(0), down = get_group_id(1), tile = get_group_id(2), at_texel = get_local_id(0);
    const int block = (tile * DRAPE_BLOCKS + down) * DRAPE_BLOCKS + across;
    const int column = across * DRAPE_BLOCK + at_texel % DRAPE_BLOCK, from_north = down * DRAPE_BLOCK + at_texel / DRAPE_BLOCK;
    const int texel = from_north * SIDE + column;
    const REAL x = (REAL)column + R(0.5), y = (REAL)(SIDE - from_north) - R(0.5);
    // What shows of the ground and what is painted, on the part of the texel that areas of the layer have left, and on
    // what they cover. Areas share borders: each covers what is left first, then what others cover.
    const REAL4 none = (REAL4)(R(0), R(0), R(0), R(0));
    REAL4 through = none + R(1), own = none, through_covered = none, own_covered = none;
    REAL left = R(1), lit = R(1);
    REAL layer = R(-1);
    bool is_bare = true;
    for (int k = starts[block]; k < starts[block + 1]; ++k) {
        const int4 row = entry[k];
        const DrapeStyle style = styles[row.s0];
        const int kind = row.s1, blending = (int)style_blend(style);
        const REAL begins = style_layer(style) != layer ? R(1) : R(0);  // factors: branches would keep drivers from using vectors
        layer = style_layer(style);
        through += through_covered * begins;
        own += own_covered * begins;
        through_covered *= R(1) - begins;
        own_covered *= R(1) - begins;
        left += (R(1) - left) * begins;
        REAL share = R(0), opacity = R(1);
        REAL4 colour = kind == ENTRY_FILL ? style.fill : style.stroke;
        if (kind == ENTRY_PICTURE) {
            const uchar4 pixel = picture[row.s2 * (SIDE * SIDE) + texel];
            colour = squared(pixel);
            share = (REAL)pixel.s3 * (R(1) / R(255)) * style_opacity(style);
        } else if (kind == ENTRY_FILL) {
            for (int i = row.s2; i < row.s2 + row.s3; ++i) {
                const REAL4 edge = piece[list[i]].line;
                share += area_east_of(edge.s0 - x + R(0.5), edge.s1 - y + R(0.5), edge.s2, edge.s3, R(1));
            }
            share = real_clamp(share, R(0), R(1));
            opacity = style_fill_opacity(style);
            if (style_hatch_spacing(style) > R(0)) opacity *= hatch_share(style, x, y, anchor[tile * style_count + row.s0]);
        } else if (kind == ENTRY_STROKE) {
            for (int i = row.s2; i < row.s2 + row.s3; ++i) share = real_max(share, stroke_share(piece[list[i]], style, x, y));
            share *= style_opacity(style);
        } else {
            const REAL radius = style_half_width(style), hole = style_fill_opacity(style) > R(0) ? DRAPE_RING * radius : R(0);
            REAL whole = R(0), inner = R(0);
            for (int i = row.s2; i < row.s2 + row.s3; ++i) {
                const REAL4 at = piece[list[i]].line;
                whole = real_max(whole, disc_share(x - at.s0, y - at.s1, radius));
                inner = real_max(inner, disc_share(x - at.s0, y - at.s1, hole));
            }
            const REAL ring = (whole - inner) * style_opacity(style);
            inner *= style_fill_opacity(style);
            share = ring + inner;
            colour = blend(style.stroke, style.fill, inner / real_max(share, R(1e-6)));
        }
        is_bare = is_bare && share * opacity <= R(0);
        lit += (R(1) - style_unlit(style) - lit) * share * opacity;
        const REAL is_area = kind == ENTRY_FILL ? R(1) : R(0), white = style_white(style);
        const REAL fresh = is_area * real_min(share, left), part = fresh / real_max(left, R(1e-6)), covered = R(1) - left;
        const REAL on_bare = mix_real(share, opacity, is_area);
        const REAL on_covered = mix_real(share, opacity * (share - fresh) / real_max(covered, R(1e-6)), is_area);
        const REAL4 kept = seen_through(colour, on_bare, blending), kept_covered = seen_through(colour, on_covered, blending);
        const REAL4 added = own_albedo(colour, white, on_bare, blending), stays = kept + (none + (R(1) - part) - kept) * is_area;
        through_covered = through_covered * kept_covered + through * kept * part;
        own_covered = own_covered * kept_covered + covered * own_albedo(colour, white, on_covered, blending) + own * kept * part + added * fresh;
        through *= stays;
        own = own * stays + added * (left * (R(1) - is_area));
        left -= fresh;
    }
    through += through_covered;
    own += own_covered;
    const int number = base_of[tile];
    const size_t place = (size_t)tile * (SIDE * SIDE) + texel;
    const uchar4 below = number < 0 ? (uchar4)(0, 0, 0, 0) : base[(size_t)number * (SIDE * SIDE) + texel];
    const REAL ground = (REAL)below.s3 * (R(1) / R(255));
    const REAL4 albedo = through * squared(below) * ground + own;
    through *= R(1) - ground;
    const REAL hidden = R(1) - real_min(real_min(through.s0, through.s1), through.s2);
    const REAL share = real_min(real_max(hidden, real_max(real_max(albedo.s0, albedo.s1), albedo.s2)), R(1));
    result[place] = is_bare ? below : as_roots(albedo / real_max(share, R(1e-6)), share);
    if (filtered) filter[place] = (uchar4)(as_byte(through.s0), as_byte(through.s1), as_byte(through.s2), as_byte(lit));
}
