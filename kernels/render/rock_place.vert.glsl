#version 430 core
// Which stone lies at a strewn place, found out once a stone and captured (render/ground_cover.py). Sizes follow a power law:
// a cell's first places, which are shown farthest, hold its largest stones. One that is not there has no size.
#include "render/frame.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#include "render/surface_map.glsl"
#include "render/scatter.glsl"
#include "render/variety.glsl"

#define RIVER_BED 6

in vec2 corner; // of the cell, relative to the eye, m
in uvec2 seed;  // the cell's hash, the place's rank

uniform vec4 strewing; // places a cell, m up to which all are shown, m of the last, m a cell's side
uniform vec3 sizes;    // m, radius of the smallest and of the largest; largest share of places where one lies
uniform sampler2DArray material_colour;
uniform float tumble;  // rad that this kind of stone lies turned over at most

out vec4 stand;  // xyz: middle relative to the eye, m; w: radius, m
out vec4 spin;   // its rotation, a quaternion
out vec4 ground; // xyz: normal; w: m of the middle over the ground
out vec4 kind;   // x: how far its edges are worn, 0..1; y: share of the sun, z: of the sky
out vec4 hue;    // rgb: mean albedo

const float POWER = -0.5;    // of a share of the places, to a radius: as many of twice the size as one in four
const float STEEP = 0.62;    // normal's z under which stones roll away
const float LYING_LOW = -0.25, LYING_HIGH = 0.30; // radii that a stone's middle lies over the ground

vec4 turned_by(vec4 a, vec4 b) // first b, then a
{
    return vec4(a.w * b.xyz + b.w * a.xyz + cross(a.xyz, b.xyz), a.w * b.w - dot(a.xyz, b.xyz));
}

// Mean albedo of a material.
vec3 mean_of(int layer)
{
    vec3 colour = textureLod(material_colour, vec3(0.5, 0.5, float(layer)), 20.0).rgb;
    return colour * colour;
}

void main()
{
    uint h = place_hash(seed.x, seed.y);
    vec2 place = corner + strewing.w * strewn(seed.x, seed.y);
    vec4 drawn = drawn_surface(place);
    vec3 foot = vec3(place, drawn.z);
    float away = length(foot);
    float up = drawn.w > 0.0 ? presence(seed.y, strewing.x, away, strewing.y, strewing.z) : 0.0;
    vec4 low = drawn_weights_low(place), high = drawn_weights_high(place);
    vec3 normal = drawn_normal(drawn);

    float a = draw_of(scrambled(h + 3u)), b = draw_of(scrambled(h + 4u)), c = draw_of(scrambled(h + 5u));
    float d = draw_of(scrambled(h + 6u)), e = draw_of(scrambled(h + 7u));
    vec2 world = place + eye.xy;
    float heap = smoothstep(-0.1, 0.8, textureLod(noise_field, world / 93.0 + 0.21, 0.0).x
        + 0.6 * textureLod(noise_field, world / 311.0 + 0.57, 0.0).y);
    // How many of the places hold a stone, by what covers the ground.
    float chance = 1.0 * low.w + 0.75 * high.z + 0.5 * low.z + (0.22 * low.y + 0.03 * high.x + 0.05 * high.y + 0.10 * high.w) * heap
        + 0.06 * low.x * heap * heap;
    chance *= sizes.z * smoothstep(STEEP - 0.12, STEEP + 0.12, normal.z);
    up *= step(d, chance * 0.999);

    float share = (float(seed.y) + a) / strewing.x;
    float radius = min(sizes.x * pow(max(share, 1e-6), POWER), sizes.y) * sqrt(up);
    vec4 clip = to_clip * vec4(foot, 1.0);
    float soft = clip.w + 4.0 * radius + 0.2;
    if (clip.w < -2.0 * radius || abs(clip.x) > soft * 1.5 || abs(clip.y) > soft * 1.5) radius = 0.0;

    // Turned about the vertical, tumbled a little, and laid along the ground.
    float half_yaw = PI * b, half_fall = 0.5 * tumble * c * c;
    vec4 yaw = vec4(0.0, 0.0, sin(half_yaw), cos(half_yaw));
    vec4 fall = vec4(sin(half_fall) * vec3(cos(6.2831853 * e), sin(6.2831853 * e), 0.0), cos(half_fall));
    vec3 upward = normalize(mix(vec3(0.0, 0.0, 1.0), normal, 0.7));
    vec4 lay = normalize(vec4(-upward.y, upward.x, 0.0, 1.0 + upward.z));
    spin = turned_by(lay, turned_by(fall, yaw));
    float over = radius * mix(LYING_LOW, LYING_HIGH, e);
    stand = vec4(foot + normal * over, radius);
    ground = vec4(normal, over);
    vec4 light = ground_light(place);
    float of_river = smoothstep(0.3, 0.6, high.z);
    kind = vec4(of_river, light.r * cloud_shadow(foot), light.g, 0.0);

    // Of the rock around, of the scree that it lies in, of the river that rolled it.
    vec4 wide = textureLod(noise_field, world / 4096.0, 0.0), middle = textureLod(noise_field, world / 512.0 + 0.37, 0.0);
    vec4 small = textureLod(noise_field, world / 64.0 + 0.71, 0.0);
    vec3 rock = mean_of(ROCK) * variety(ROCK, wide, middle, small), scree = mean_of(SCREE) * variety(SCREE, wide, middle, small);
    vec3 lying = mix(mix(rock, scree, smoothstep(0.15, 0.6, low.w)), mean_of(RIVER_BED), of_river);
    hue = vec4(lying * mix(0.78, 1.22, c) * mix(vec3(1.06, 1.0, 0.94), vec3(0.95, 1.0, 1.05), b), 0.0);
    gl_Position = vec4(0.0);
}
