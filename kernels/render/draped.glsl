// Coverage and colour of parts of draped features: segments of lines, triangles of areas, points, by the place in their
// own coordinates (m): x along the segment, y across. What drape.clh does for square texels this does for pixels.
//   change  derivatives of a place: its columns are those along x and y of the picture, per px
//   metres  on the ground in a pixel
layout(std430, binding = 2) readonly buffer DrapedParts { vec4 draped_parts[]; };   // length, m; along, m; style; flags
layout(std430, binding = 3) readonly buffer DrapedStyles { vec4 draped_styles[]; }; // STYLE_ROWS each

// Rows of `DrapeStyle` in kernels/drape.clh, with lengths in m or px.
const int STYLE_ROWS = 10, DASHES = 6;
const int STARTS = 1, ENDS = 2, IS_FILL = 16, IS_POINT = 32;
const float BUTT = 0.0, ROUND = 1.0, SQUARE = 2.0, MITRE = 1.0;
const float MANY = 8.0; // periods in a pixel, from which on a pattern is its mean
const float RING = 0.7; // of the radius of points, from where on they have the colour of outlines

// Share of an interval of a width about a place that lies between two limits.
float overlap(float place, float width, float low, float high)
{
    return max(min(place + 0.5 * width, high) - max(place - 0.5 * width, low), 0.0) / width;
}

float pulse_integral(float x, float period, float duty)
{
    float turns = x / period, whole = floor(turns);
    return period * (whole * duty + min(turns - whole, duty));
}

// Mean over an interval of a train of pulses: 1 from each multiple of `period` on for `duty` of it.
float pulses(float x, float period, float duty, float width)
{
    x -= floor(x / period) * period;
    float mean = (pulse_integral(x + 0.5 * width, period, duty) - pulse_integral(x - 0.5 * width, period, duty)) / width;
    return width > MANY * period ? duty : clamp(mean, 0.0, 1.0);
}

float change_of(vec2 direction, mat2 change) { return max(length(direction * change), 1e-6); }

// Width of a pixel away from a place, along the line to it.
float change_away(vec2 away, mat2 change)
{
    float distance = length(away);
    return change_of(distance > 1e-6 ? away / distance : vec2(0.0, 1.0), change);
}

float dash_share(vec2 place, mat2 change, float half_width, float cap, int row, float unit, float period)
{
    float more = cap == BUTT ? 0.0 : cap == SQUARE ? half_width : sqrt(max(half_width * half_width - place.y * place.y, 0.0));
    float width = change_of(vec2(1.0, 0.0), change), share = 0.0;
    for (int k = 0; k < 8; ++k) {
        vec4 both = draped_styles[row + k / 2] * unit;
        vec2 dash = k % 2 == 0 ? both.xy : both.zw;
        if (dash.y > 0.0) share += pulses(place.x - dash.x + more, period, min((dash.y + 2.0 * more) / period, 1.0), width);
    }
    return min(share, 1.0);
}

float hatch_share(vec2 place, mat2 change, float spacing, float duty, bool crosses)
{
    if (spacing == 0.0) return 1.0;
    vec2 at = place + 0.5 * spacing * duty;
    float lines = pulses(at.y, spacing, duty, change_of(vec2(0.0, 1.0), change));
    if (!crosses) return lines;
    float others = pulses(at.x, spacing, duty, change_of(vec2(1.0, 0.0), change));
    return lines + others - lines * others;
}

float stroke_share(vec2 place, mat2 change, vec4 part, float line_cap, float line_join, float half_width)
{
    int flags = int(part.w);
    bool before = place.x < 0.0, starts = (flags & STARTS) != 0, ends = (flags & ENDS) != 0;
    float beyond = max(max(-place.x, place.x - part.x), 0.0);
    bool is_round = beyond > 0.0 && (before ? starts : ends) ? line_cap == ROUND : line_join != MITRE;
    vec2 away = vec2(is_round ? (before ? -beyond : beyond) : 0.0, place.y);
    float share = overlap(length(away), change_away(away, change), -half_width, half_width);
    // Ends that are not round, and mitres.
    float longer = change_of(vec2(1.0, 0.0), change), cap = line_cap == BUTT ? 0.0 : half_width;
    float open = is_round ? 1e9 : half_width;
    return share * overlap(place.x, longer, starts && line_cap != ROUND ? -cap : -open, part.x + (ends && line_cap != ROUND ? cap : open));
}

// Albedo times opacity, and opacity, of a part at a place.
vec4 draped_colour(vec2 place, mat2 change, vec4 part, float metres)
{
    int row = int(part.z) * STYLE_ROWS, flags = int(part.w);
    vec4 form = draped_styles[row + 2], hatch = draped_styles[row + 3], period = draped_styles[row + 4];
    vec4 white = vec4(vec3(period.w), 1.0), stroke = white * draped_styles[row], fill = white * draped_styles[row + 1];
    float unit = draped_styles[row + 5].z > 0.5 ? metres : 1.0, half_width = form.x * unit;
    if ((flags & IS_FILL) != 0)
        return vec4(fill.rgb, 1.0) * (fill.a * hatch_share(place, change, hatch.z * unit, hatch.w, period.z > 0.0));
    if ((flags & IS_POINT) != 0) {
        float away = length(place), wide = change_away(place, change), hole = fill.a > 0.0 ? RING * half_width : 0.0;
        float inner = overlap(away, wide, -hole, hole);
        float ring = overlap(away, wide, -half_width, half_width) - inner;
        return vec4(stroke.rgb, 1.0) * (stroke.a * ring) + vec4(fill.rgb, 1.0) * (fill.a * inner);
    }
    float share = stroke_share(place, change, part, form.y, form.z, half_width);
    if (period.x > 0.0) {
        vec2 at = vec2(part.y + clamp(place.x, 0.0, part.x), place.y);
        share *= dash_share(at, change, half_width, form.y, row + DASHES, unit, period.x * unit);
    }
    return vec4(stroke.rgb, 1.0) * (stroke.a * share);
}
