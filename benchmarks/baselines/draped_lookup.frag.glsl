#version 430 core
// Per-pixel lookup: each pixel of the ground sums up the parts in the list of its cell. Areas are exact for the
// parallelogram that a pixel is on the plane of its ground; hatches are left out.
//   LEVELS, CELLS  grids around the eye, cells along their sides;  SAMPLES  of the G-buffer along each axis of a pixel
#include "render/frame.glsl"
#include "render/gbuffer.glsl"
#include "render/draped.glsl"

layout(std430, binding = 4) readonly buffer Cells { uvec2 cells[]; };   // first in `listed`, count
layout(std430, binding = 5) readonly buffer Listed { uint listed[]; };  // pieces, in their order
layout(std430, binding = 6) readonly buffer Pieces { vec4 pieces[]; };  // two each: origin and direction, or three corners
uniform sampler2D ground_depth;
uniform sampler2D ground_normal;
uniform vec3 levels[LEVELS]; // south-west corner from the eye, width of a cell, m

layout(location = 0) out vec4 colour;

float below(float x) { return x < 0.0 ? 0.0 : x < 1.0 ? 0.5 * x * x : x - 0.5; }

// Area of a unit pixel to the right of an edge, signed: area_east_of in kernels/appearance.clh.
float area_right_of(vec2 start, vec2 end)
{
    float low = clamp(start.y, 0.0, 1.0), high = clamp(end.y, 0.0, 1.0), tall = high - low;
    float run = (end.x - start.x) / (end.y == start.y ? 1.0 : end.y - start.y);
    float from = 1.0 - (start.x + (low - start.y) * run), to = 1.0 - (start.x + (high - start.y) * run), wide = to - from;
    float mean = abs(wide) < 1e-3 ? clamp(0.5 * (from + to), 0.0, 1.0) : (below(to) - below(from)) / wide;
    return -tall * mean;
}

vec3 on_ray(vec2 screen, float depth)
{
    vec4 place = from_clip * vec4(screen, 2.0 * depth - 1.0, 1.0);
    return place.xyz / place.w;
}

// Where a ray to a place meets a plane, not much farther off.
vec3 met(vec3 along, vec3 n, float level_of)
{
    float facing = dot(n, along), least = 0.02 * length(along);
    return along * clamp(level_of / (abs(facing) < least ? (facing < 0.0 ? -least : least) : facing), 0.5, 2.0);
}

void over(vec4 top) { colour = top + colour * (1.0 - top.a); }

void main()
{
    colour = vec4(0.0);
    float depth;
    ivec2 pixel = ivec2(gl_FragCoord.xy), at = nearest_sample(ground_depth, pixel, depth);
    if (depth >= 1.0) discard;
    // The plane of the ground, and where rays of the pixel and of the next ones meet it.
    vec2 size = vec2(textureSize(ground_depth, 0)), step_ = 2.0 * float(SAMPLES) / size;
    vec3 n = normalize(texelFetch(ground_normal, at, 0).xyz);
    float level_of = dot(n, on_ray(2.0 * (vec2(at) + 0.5) / size - 1.0, depth));
    vec2 middle = 2.0 * (vec2(pixel) + 0.5) * float(SAMPLES) / size - 1.0;
    vec3 position = met(on_ray(middle, depth), n, level_of);
    mat2 change = mat2(met(on_ray(middle + vec2(step_.x, 0.0), depth), n, level_of).xy - position.xy,
                       met(on_ray(middle + vec2(0.0, step_.y), depth), n, level_of).xy - position.xy);
    int level = 0;
    vec2 cell = vec2(-1.0);
    for (; level < LEVELS; ++level) {
        cell = (position.xy - levels[level].xy) / levels[level].z;
        if (all(greaterThan(cell, vec2(0.0))) && all(lessThan(cell, vec2(float(CELLS))))) break;
    }
    if (level == LEVELS) discard;
    ivec2 place = ivec2(cell);
    uvec2 range = cells[(level * CELLS + place.y) * CELLS + place.x];
    vec2 here = position.xy - levels[level].xy;
    mat2 to_pixel = inverse(change);
    float group = -1.0, area = 0.0;
    vec4 best = vec4(0.0); // of the group so far
    for (uint k = range.x; k < range.x + range.y; ++k) {
        uint number = listed[k];
        vec4 one = pieces[2u * number], two = pieces[2u * number + 1u], part = draped_parts[number];
        if (two.z != group) {
            over(best);
            best = vec4(0.0);
            group = two.z;
            area = 0.0;
        }
        if ((int(part.w) & IS_FILL) != 0) {
            vec2 a = to_pixel * (one.xy - here) + 0.5, b = to_pixel * (one.zw - here) + 0.5, c = to_pixel * (two.xy - here) + 0.5;
            area += abs(area_right_of(a, b) + area_right_of(b, c) + area_right_of(c, a));
            vec4 fill = draped_styles[int(part.z) * STYLE_ROWS + 1];
            best = vec4(fill.rgb, 1.0) * (fill.a * min(area, 1.0));
        } else {
            mat2 turned = mat2(one.z, -one.w, one.w, one.z);
            vec4 found = draped_colour(turned * (here - one.xy), turned * change, part, length(position) * trees.z);
            best = found.a > best.a ? found : best;
        }
    }
    over(best);
}
