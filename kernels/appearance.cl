// Appearance tiles: √ of the albedo of roads, land use and draped layers, and the share of each texel that they cover.
#include "drape.clh"

#define SIDE 192 // texels along a tile
#define BLOCK 8  // … along a group, for which areas, roads and entries are listed
#define BLOCKS (SIDE / BLOCK)
#define ENTRY_STROKE 0 // kinds of entries
#define ENTRY_FILL 1
#define ENTRY_POINT 2
#define ENTRY_PICTURE 3
#define DRAPE_RING R(0.7)  // of the radius of points, from where on they have the colour of outlines

//   corner    long2 a tile: its south-west corner, lattice units; texels are counted from the north, the first row and
//             column are outside
//   texel     side of a texel, m;  metres_per_unit  m a lattice unit
//   bits      of the lattice units that noise of three scales takes
//   road_at, road_row     long2, PaintedRoad a piece
//   area_at, area_row, area_form  long2, PaintedArea an area; int4: first edge, number of edges, use, crop
//   edge      REAL4 an edge: start, vector to the end, m from `area_at`
//   starts    int4 a block: of areas and roads in `list`, of entries; each from the lowest to the highest; of pieces in `list`
//   list      numbers of areas, of roads, and of pieces
//   entry     int4: style, ENTRY_…, first among the pieces listed, or the picture, and number of pieces: of one feature
//   anchor    REAL2 a style of a tile: place of the tile's corner in its hatch, if any style has one
//   picture   uchar4 a texel: √ of red, green, blue, 1 for white, and opacity
//   base      uchar4 a texel: what lies below everything, in the form of the result
//   result    uchar4 a texel: √ of red, green, blue, and the share
//   filtered  whether `filter`, uchar4 a texel, has what of the ground's red, green and blue is seen, and what is lit
__kernel void appearance(__global const long2 *corner, REAL texel, REAL metres_per_unit, int4 bits,
                         __global const long2 *road_at, __global const PaintedRoad *road_row,
                         __global const long2 *area_at, __global const PaintedArea *area_row,
                         __global const int4 *area_form, __global const REAL4 *edge,
                         __global const int4 *starts, __global const int *list, __global const int4 *entry,
                         __global const DrapePiece *piece, __global const REAL2 *anchor,
                         __global const DrapeStyle *styles, __global const uchar4 *picture,
                         __global const uchar4 *base, int has_base, int style_count, int filtered,
                         __global uchar4 *result, __global uchar4 *filter)
{
    const int across = get_group_id(0), down = get_group_id(1), tile = get_group_id(2), at_texel = get_local_id(0);
    const int block = (tile * BLOCKS + down) * BLOCKS + across;
    const int4 first = starts[block], end = starts[block + 1];
    const int column = across * BLOCK + at_texel % BLOCK, from_north = down * BLOCK + at_texel / BLOCK;
    const size_t place = ((size_t)tile * SIDE + from_north) * SIDE + column;
    const REAL east = ((REAL)column - R(0.5)) * texel, north = ((REAL)(SIDE - 2 - from_north) + R(0.5)) * texel;
    const long x = corner[tile].s0, y = corner[tile].s1;
    Mottle mottle = {R(0.5), R(0.5), R(0.5)};
    if (end.s0 > first.s0 || end.s1 > first.s1) {
        const REAL units = R(1) / metres_per_unit, wide = texel * units;
        const long x_here = x + (long)floor(east * units), y_here = y + (long)floor(north * units);
        mottle.wide = value_noise(x_here, y_here, bits.s0, wide, 11u);
        mottle.middle = value_noise(x_here, y_here, bits.s1, wide, 12u);
        mottle.small = value_noise(x_here, y_here, bits.s2, wide, 13u);
    }

    Paint land = {(REAL4)(R(0), R(0), R(0), R(0)), R(0)};
    REAL4 beside = land.albedo; // colour that interpolation fades out from, where nothing is painted
    REAL left = R(1), settled = R(0);
    for (int k = end.s0 - 1; k >= first.s0; --k) { // from the top one down
        const int i = list[k];
        const PaintedArea row = area_row[i];
        const int4 form = area_form[i];
        const REAL px = (REAL)(x - area_at[i].s0) * metres_per_unit + east, py = (REAL)(y - area_at[i].s1) * metres_per_unit + north;
        const REAL half_texel = R(0.5) * texel;
        if (px + half_texel <= row.box.s0 || py + half_texel <= row.box.s1 || px - half_texel >= row.box.s2 || py - half_texel >= row.box.s3) continue;
        REAL inside = R(0), nearest = R(1e30);
        for (int e = form.s0; e < form.s0 + form.s1; ++e) {
            const REAL4 side = edge[e];
            const REAL dx = px - side.s0, dy = py - side.s1;
            inside += area_east_of(half_texel - dx, half_texel - dy, side.s2, side.s3, texel);
            const REAL t = real_clamp((dx * side.s2 + dy * side.s3) / (side.s2 * side.s2 + side.s3 * side.s3), R(0), R(1));
            const REAL off_x = dx - t * side.s2, off_y = dy - t * side.s3, square = off_x * off_x + off_y * off_y;
            nearest = real_min(nearest, square);
        }
        const REAL share = real_min(real_clamp(inside / (texel * texel), R(0), R(1)), left);
        if (share <= R(0) && nearest > R(4) * texel * texel) continue;
        const Paint paint = paint_area(row, form.s2, form.s3, px, py, square_root(nearest), texel, mottle);
        beside = paint.albedo;
        left -= share;
        settled += form.s2 == USE_BUILT_UP ? share : R(0);
        land.albedo += paint.albedo * (paint.share * share);
        land.share += paint.share * share;
    }
    Paint paint = {land.share > R(1e-6) ? land.albedo / land.share : beside, land.share};
    if (has_base) {
        const uchar4 below = base[place];
        const Paint ground = {squared(below), (REAL)below.s3 * (R(1) / R(255))};
        paint = over(ground, paint.albedo, paint.share * (R(1) - PHOTO_KEPT * ground.share));
    }

    RoadPlace best = {R(1e30), R(0), R(0), -1, false};
    for (int k = first.s1; k < end.s1; ++k) {
        const int i = list[k];
        const PaintedRoad row = road_row[i];
        const REAL dx = (REAL)(x - road_at[i].s0) * metres_per_unit + east, dy = (REAL)(y - road_at[i].s1) * metres_per_unit + north;
        const ArcFoot foot = nearest_on_arc(row.chord, piece_bend(row), dx, dy);
        const int ends = (int)piece_ends(row);
        const bool cut = ((ends & END_CUT_START) && foot.t <= R(0)) || ((ends & END_CUT_END) && foot.t >= R(1));
        const REAL away = square_root(foot.square);
        // Surfaces of asphalt lie on those of tracks and paths, and rails on both.
        const int surface = (int)piece_surface(row);
        const REAL rank = surface == SURFACE_RAILS ? R(-1) : surface == SURFACE_ASPHALT ? R(0) : R(1);
        const REAL ratio = away / mix_real(piece_from_half(row), piece_to_half(row), foot.t) + rank;
        if (cut || ratio >= best.ratio) continue;
        best.ratio = ratio;
        best.t = foot.t;
        best.away = away;
        best.piece = i;
        best.left = foot.left;
    }
    if (best.piece >= 0) paint = paint_road(paint, road_row[best.piece], best, texel, mottle, settled);

    // Draped layers, in texels from the outermost south-western corner.
    const REAL u = (REAL)column + R(0.5), v = (REAL)(SIDE - from_north) - R(0.5);
    // What shows of the ground and what is painted, on the part of the texel that areas of the layer have left, and on
    // what they cover. Areas share borders: each covers what is left first, then what others cover.
    const REAL4 none = (REAL4)(R(0), R(0), R(0), R(0));
    REAL4 through = none + R(1), own = none, through_covered = none, own_covered = none;
    REAL lit = R(1);
    left = R(1);
    REAL layer = R(-1);
    bool is_bare = true;
    for (int k = first.s2; k < end.s2; ++k) {
        int4 row = entry[k];
        row.s2 += entry[k].s1 == ENTRY_PICTURE ? 0 : first.s3;
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
            const uchar4 pixel = picture[row.s2 * (SIDE * SIDE) + from_north * SIDE + column];
            colour = squared(pixel);
            share = (REAL)pixel.s3 * (R(1) / R(255)) * style_opacity(style);
        } else if (kind == ENTRY_FILL) {
            for (int i = row.s2; i < row.s2 + row.s3; ++i) {
                const REAL4 side = piece[list[i]].line;
                share += area_east_of(side.s0 - u + R(0.5), side.s1 - v + R(0.5), side.s2, side.s3, R(1));
            }
            share = real_clamp(share, R(0), R(1));
            opacity = style_fill_opacity(style);
            if (style_hatch_spacing(style) > R(0)) opacity *= hatch_share(style, u, v, anchor[tile * style_count + row.s0]);
        } else if (kind == ENTRY_STROKE) {
            for (int i = row.s2; i < row.s2 + row.s3; ++i) share = real_max(share, stroke_share(piece[list[i]], style, u, v));
            share *= style_opacity(style);
        } else {
            const REAL radius = style_half_width(style), hole = style_fill_opacity(style) > R(0) ? DRAPE_RING * radius : R(0);
            REAL whole = R(0), inner = R(0);
            for (int i = row.s2; i < row.s2 + row.s3; ++i) {
                const REAL4 at = piece[list[i]].line;
                whole = real_max(whole, disc_share(u - at.s0, v - at.s1, radius));
                inner = real_max(inner, disc_share(u - at.s0, v - at.s1, hole));
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
    const REAL4 albedo = through * paint.albedo * paint.share + own;
    through *= R(1) - paint.share;
    if (!is_bare) {
        const REAL hidden = R(1) - real_min(real_min(through.s0, through.s1), through.s2);
        paint.share = real_min(real_max(hidden, real_max(real_max(albedo.s0, albedo.s1), albedo.s2)), R(1));
        paint.albedo = albedo / real_max(paint.share, R(1e-6));
    }
    result[place] = as_roots(paint.albedo, paint.share);
    if (filtered) filter[place] = (uchar4)(as_byte(through.s0), as_byte(through.s1), as_byte(through.s2), as_byte(lit));
}

// Mean albedo of areas and the share that their paint covers, as a texel that they fill shows them.
//   result  REAL4 an area
__kernel void area_means(REAL texel, __global const PaintedArea *area_row, __global const int4 *area_form, __global REAL4 *result)
{
    const int i = get_global_id(0);
    const Mottle mean = {R(0.5), R(0.5), R(0.5)};
    const Paint paint = paint_area(area_row[i], area_form[i].s2, area_form[i].s3, R(0), R(0), texel, texel, mean);
    result[i] = (REAL4)(paint.albedo.s0, paint.albedo.s1, paint.albedo.s2, paint.share);
}
