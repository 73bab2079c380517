#version 430 core
// Stone at a scattered point, captured by transform feedback (render/ground_cover.py). Sizes follow a power law: a cell's
// first points, which are visible farthest, hold its largest stones. Its radius is 0 where none lies.
// Macros of render/textures.py say which materials have which stones.
#include "render/frame.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#include "render/surface_map.glsl"
#include "render/scatter.glsl"
#include "render/variety.glsl"
#if APPEARANCE
#include "render/appearance.glsl"
#endif

in vec2 corner; // of the cell, relative to the eye, m
in uvec2 seed;  // the cell's hash, the point's rank

uniform vec4 scatter_layer; // points a cell, distance of full density, draw distance, cell size (m)
uniform vec3 sizes;    // smallest and largest radius, m; largest share of points with a stone
uniform sampler2DArray material_colour;
uniform float max_tilt;  // rad

out vec4 centre_radius;  // xyz: centre relative to the eye, m; w: radius, m
out vec4 spin;   // its rotation, a quaternion
out vec4 ground; // xyz: normal; w: height of the centre over the ground, m
out vec4 kind;   // x: wear of its edges, 0..1; y: sun visibility, z: sky visibility
out vec4 hue;    // rgb: mean albedo

const vec2 CLEARED = vec2(0.2, 0.5); // share of land use over which stones are cleared from it
const float POWER = -0.5;    // of the radius by rank: one stone in four has twice the size
const float STEEP = 0.62;    // normal's z below which stones roll away
const float LYING_LOW = -0.25, LYING_HIGH = 0.30; // height of a stone's centre over the ground, radii

vec4 quaternion_product(vec4 a, vec4 b) // rotates by b, then a
{
    return vec4(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}

// Mean albedo of a material with its variety.
vec3 stone_albedo(int layer, vec4 wide, vec4 middle, vec4 small)
{
    vec3 colour = textureLod(material_colour, vec3(0.5, 0.5, float(layer)), 20.0).rgb;
    return colour * colour * variety(layer, wide, middle, small);
}

void main()
{
    uint h = point_hash(seed.x, seed.y);
    vec2 place = corner + scatter_layer.w * scatter_position(seed.x, seed.y);
    vec4 drawn = drawn_surface(place);
    vec3 foot = vec3(place, drawn.z);
    float away = length(foot);
    float up = drawn.w > 0.0 ? presence(seed.y, scatter_layer.x, away, scatter_layer.y, scatter_layer.z) : 0.0;
    vec4 weights[WEIGHT_WORDS];
    drawn_weights(place, weights);
    vec3 normal = drawn_normal(drawn);

    float a = unit_float(hash32(h + 3u)), b = unit_float(hash32(h + 4u)), c = unit_float(hash32(h + 5u));
    float d = unit_float(hash32(h + 6u)), e = unit_float(hash32(h + 7u));
    vec2 world = place + eye.xy;
    float heap = smoothstep(-0.1, 0.8, textureLod(noise_field, world / 93.0 + 0.21, 0.0).x
        + 0.6 * textureLod(noise_field, world / 311.0 + 0.57, 0.0).y);
    float chance = STONES_ANYWHERE(weights) + (STONES_IN_HEAPS(weights) + STONES_IN_MIDDLES(weights) * heap) * heap;
    chance *= clamp(1.0 - 8.0 * PAVED(weights), 0.0, 1.0); // a stone is wider than its place
#if APPEARANCE
    vec3 through;
    painted_about(place, sizes.y, through);
    chance *= 1.0 - smoothstep(CLEARED.x, CLEARED.y, 1.0 - max(max(through.r, through.g), through.b));
#endif
    chance *= sizes.z * smoothstep(STEEP - 0.12, STEEP + 0.12, normal.z);
    up *= step(d, chance * 0.999);

    float share = (float(seed.y) + a) / scatter_layer.x;
    float radius = min(sizes.x * pow(max(share, 1e-6), POWER), sizes.y) * sqrt(up);
    vec4 clip = to_clip * vec4(foot, 1.0);
    float soft = clip.w + 4.0 * radius + 0.2;
    if (clip.w < -2.0 * radius || abs(clip.x) > soft * 1.5 || abs(clip.y) > soft * 1.5) radius = 0.0;

    // Rotated about the vertical, tilted, and aligned with the ground.
    float half_yaw = PI * b, half_fall = 0.5 * max_tilt * c * c;
    vec4 yaw = vec4(0.0, 0.0, sin(half_yaw), cos(half_yaw));
    vec4 fall = vec4(sin(half_fall) * vec3(cos(6.2831853 * e), sin(6.2831853 * e), 0.0), cos(half_fall));
    vec3 upward = normalize(mix(vec3(0.0, 0.0, 1.0), normal, 0.7));
    vec4 lay = normalize(vec4(-upward.y, upward.x, 0.0, 1.0 + upward.z));
    spin = quaternion_product(lay, quaternion_product(fall, yaw));
    float over = radius * mix(LYING_LOW, LYING_HIGH, e);
    centre_radius = vec4(foot + normal * over, radius);
    ground = vec4(normal, over);
    vec4 light = ground_light(place);
    kind = vec4(STONE_WEAR(weights), light.r * cloud_shadow(foot), light.g, 0.0);

    // Albedo of the ground's own stones, else of bedrock.
    vec4 wide = textureLod(noise_field, world / 4096.0, 0.0), middle = textureLod(noise_field, world / 512.0 + 0.37, 0.0);
    vec4 small = textureLod(noise_field, world / 64.0 + 0.71, 0.0);
    vec3 lying = stone_albedo(BEDROCK, wide, middle, small);
    STONE_COLOURS
    hue = vec4(lying * mix(0.78, 1.22, c) * mix(vec3(1.06, 1.0, 0.94), vec3(0.95, 1.0, 1.05), b), 0.0);
    gl_Position = vec4(0.0);
}
