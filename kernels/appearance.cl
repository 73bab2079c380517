// Appearance tiles: √ of the albedo of roads and of land use, and the share of each texel that they cover.
#include "appearance.clh"

#define SIDE 192  // texels along a tile
#define BLOCK 32  // … along a group for which roads and areas are listed
#define BLOCKS (SIDE / BLOCK)

//   corner    long2 a tile: its south-west corner, lattice units; texels are counted from the north, the first row and
//             column are outside
//   texel     side of a texel, m;  metres_per_unit  m a lattice unit
//   bits      of the lattice units that noise of three scales takes
//   road_at, road_row     long2, PaintedRoad a piece
//   area_at, area_row, area_form  long2, PaintedArea an area; int4: first edge, number of edges, use, crop
//   edge      REAL4 an edge: start, vector to the end, m from `area_at`
//   road_starts, road_list, area_starts, area_list  of each block, from the lowest to the highest
//   base      uchar4 a texel: what lies below everything, in the form of the result
//   result    uchar4 a texel: √ of red, green, blue, and the share
__kernel void appearance(__global const long2 *corner, REAL texel, REAL metres_per_unit, int4 bits,
                         __global const long2 *road_at, __global const PaintedRoad *road_row,
                         __global const int *road_starts, __global const int *road_list,
                         __global const long2 *area_at, __global const PaintedArea *area_row,
                         __global const int4 *area_form, __global const REAL4 *edge,
                         __global const int *area_starts, __global const int *area_list,
                         int has_base, __global const uchar4 *base, __global uchar4 *result)
{
    const int column = get_global_id(0), from_north = get_global_id(1), tile = get_global_id(2);
    const int block = (tile * BLOCKS + from_north / BLOCK) * BLOCKS + (int)get_group_id(0);
    const size_t place = ((size_t)tile * SIDE + from_north) * SIDE + column;
    const REAL east = ((REAL)column - R(0.5)) * texel, north = ((REAL)(SIDE - 2 - from_north) + R(0.5)) * texel;
    const long x = corner[tile].s0, y = corner[tile].s1;
    const REAL units = R(1) / metres_per_unit, wide = texel * units;
    const long x_here = x + (long)floor(east * units), y_here = y + (long)floor(north * units);
    const Mottle mottle = {value_noise(x_here, y_here, bits.s0, wide, 11u), value_noise(x_here, y_here, bits.s1, wide, 12u),
                           value_noise(x_here, y_here, bits.s2, wide, 13u)};

    Paint land = {(REAL4)(R(0), R(0), R(0), R(0)), R(0)};
    REAL4 beside = land.albedo; // colour that interpolation fades out from, where nothing is painted
    REAL left = R(1), settled = R(0);
    for (int k = area_starts[block + 1] - 1; k >= area_starts[block]; --k) { // from the top one down
        const int i = area_list[k];
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
    for (int k = road_starts[block]; k < road_starts[block + 1]; ++k) {
        const int i = road_list[k];
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
    result[place] = as_roots(paint.albedo, paint.share);
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
