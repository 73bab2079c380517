// Coverage and colour of parts of draped features: segments of lines and triangles of areas, by the place in their own
// coordinates (m): x along the segment, y across. sketchterrain/render/draped_geometry.py has the tables.
//   change  derivatives of a place: its columns are those along x and y of the picture, per px
//   metres  on the ground in a pixel
layout(std430, binding = 2) readonly buffer DrapedParts { vec4 draped_parts[]; };   // length, m; along, m; style; flags
layout(std430, binding = 3) readonly buffer DrapedStyles { vec4 draped_styles[]; }; // STYLE_ROWS each

const int STYLE_ROWS = 6; // √albedo, opacity; the same of areas; width, whether in px, cap, join; 8 dashes; hatch
const int STARTS = 1, ENDS = 2, IS_FILL = 16;
const float BUTT = 0.0, ROUND = 1.0, SQUARE = 2.0, MITRE = 2.0;

// Share of an interval of a width about a place that lies between two limits.
float overlap(float place, float width, float low, float high)
{
    return max(min(place + 0.5 * width, high) - max(place - 0.5 * width, low), 0.0) / width;
}

// Length of an interval that a train of dashes and gaps, given by their ends, covers.
float dashed(float place, float width, float unit, vec4 one, vec4 two)
{
    float total = unit * (dot(one, vec4(1.0)) + dot(two, vec4(1.0)));
    float start = place - 0.5 * width;
    start -= floor(start / total) * total;
    float sum = 0.0, below = 0.0;
    float whole = unit * (one.x + one.z + two.x + two.z);
    for (int end = 0; end < 2; ++end) {
        float at = start + (end == 0 ? 0.0 : width), turns = floor(at / total), low = 0.0;
        float covered = turns * whole;
        at -= turns * total;
        for (int k = 0; k < 8; ++k) {
            float dash = unit * (k < 4 ? one[k] : two[k - 4]);
            covered += k % 2 == 0 ? clamp(at - low, 0.0, dash) : 0.0;
            low += dash;
        }
        sum = end == 0 ? -covered : sum + covered;
    }
    return sum / width;
}

float change_of(vec2 direction, mat2 change) { return max(length(direction * change), 1e-6); }

float hatch_share(vec2 place, mat2 change, vec4 hatch, float width)
{
    if (hatch.x == 0.0) return 1.0;
    vec4 gap = vec4(width, max(hatch.y - width, 0.0), 0.0, 0.0);
    float share = dashed(place.y, change_of(vec2(0.0, 1.0), change), 1.0, gap, vec4(0.0));
    if (hatch.x == 1.0) return share;
    return share + (1.0 - share) * dashed(place.x, change_of(vec2(1.0, 0.0), change), 1.0, gap, vec4(0.0));
}

float stroke_share(vec2 place, mat2 change, vec4 part, vec4 line, float half_width, float unit, vec4 one, vec4 two)
{
    bool before = place.x < 0.0;
    float beyond = max(max(-place.x, place.x - part.x), 0.0);
    bool is_end = beyond > 0.0 && (int(part.w) & (before ? STARTS : ENDS)) != 0;
    bool is_round = is_end ? line.z == ROUND : line.w != MITRE;
    vec2 away = vec2(is_round ? (before ? -beyond : beyond) : 0.0, place.y);
    float distance = length(away);
    float wide = change_of(distance > 1e-6 ? away / distance : vec2(0.0, 1.0), change);
    float share = overlap(distance, wide, -half_width, half_width);
    float longer = change_of(vec2(1.0, 0.0), change);
    if (!is_round || (int(part.w) & (STARTS | ENDS)) != 0) {
        // Ends that are not round, and corners that are cut.
        bool starts = (int(part.w) & STARTS) != 0, ends = (int(part.w) & ENDS) != 0;
        float extra = line.z == SQUARE ? half_width : 0.0;
        float far = 2.0 * half_width + 2.0 * longer;
        float low = starts ? (line.z == ROUND ? -far : -extra) : -(is_round ? far : half_width + longer);
        float high = part.x + (ends ? (line.z == ROUND ? far : extra) : is_round ? far : half_width + longer);
        share *= overlap(place.x, longer, low, high);
    }
    if (one.x > 0.0) share *= dashed(part.y + clamp(place.x, 0.0, part.x), longer, unit, one, two);
    return share;
}

// √albedo times opacity, and opacity, of a part at a place.
vec4 draped_colour(vec2 place, mat2 change, vec4 part, float metres)
{
    int row = int(part.z) * STYLE_ROWS;
    vec4 line = draped_styles[row + 2], hatch = draped_styles[row + 5];
    bool is_fill = (int(part.w) & IS_FILL) != 0;
    float unit = line.y > 0.5 ? metres : 1.0;
    vec4 colour = draped_styles[row + (is_fill ? 1 : 0)];
    float share = is_fill
        ? hatch_share(place, change, vec4(hatch.x, hatch.y * unit, 0.0, 0.0), line.x * unit)
        : stroke_share(place, change, part, line, 0.5 * line.x * unit, unit, draped_styles[row + 3], draped_styles[row + 4]);
    return vec4(colour.rgb, 1.0) * (colour.a * share);
}
