#version 430 core
// One vertex of one plant. A plant that comes, goes or passes into another detail loses its triangles one by one.
//   FAR 1: it is lit here, as a triangle is about as large as a pixel; else in tree.frag.glsl
#include "render/frame.glsl"
#include "render/tree_wind.glsl"
#if FAR
#include "render/tree_light.glsl"
#endif
#ifndef SHADE_MAPS
#define SHADE_MAPS 2
#endif

uniform vec3 anchor; // of all plants, relative to the eye, m
uniform float clock; // s

in vec3 place;     // in heights of the plant, from its foot
in vec4 outward;   // xyz: normal, 0..1 for -1..1; w: 1 leaf, 0 wood
in vec4 colour;    // rgb: √albedo, a: openness to the sky
in vec4 sprig_at;  // xy: place on its spray, 0..1; z: what is cut out; w: phase of its bough
in vec4 stand;     // xyz: foot, m from the anchor; w: height, m
in vec4 ground;    // see tree_stand.vert.glsl
in vec4 sway;
#if FAR
in vec4 veil;
in vec4 clear;
#endif
in vec4 manner;    // xy: cosine and sine of its rotation, times as wide as it is drawn; z: temper; w: share of its triangles that is drawn

#if FAR
out vec3 seen; // radiance
#else
out vec3 position;
out vec4 leaf_normal; // w: 1 leaf, 0 wood
out vec3 albedo;
out vec3 light; // x: sun over the bare ground; y: sky over it, as far as other plants leave it; z: openness within the plant
out vec3 cut;   // xy: place on its spray, 0..1; z: what is cut out
#endif

const float DEEP_SHADE = 0.55;   // what a dense forest takes of the sky's light at its floor
const float CROWD_SHADE = 0.75;  // what a dense forest takes of the sun low down, where no map tells
const float SHADED = 0.30, LIT = 0.80; // openness within a forest's crown up to which no sun comes, and from which all does
const float LIT_ALONE = 0.50;    // the latter for a plant without neighbours
const float WARM_BOUGH = 0.16;   // how much boughs differ in colour

// 0..1 for a triangle of a plant.
float draw_of(int triangle, float temper)
{
    uint h = uint(triangle) * 0x9e3779b9u ^ floatBitsToUint(temper);
    h ^= h >> 16; h *= 0x7feb352du; h ^= h >> 15;
    return float(h & 0xffffu) / 65536.0;
}

void main()
{
    mat2 turn = mat2(manner.x, manner.y, -manner.y, manner.x);
    vec3 foot = vec3(anchor.xy + stand.xy, ground.x);
    vec3 at = vec3(turn * place.xy, place.z);
    vec3 point = foot + stand.w * at + swayed(at, stand.w, sway, sprig_at.w, outward.w, clock);
    vec3 normal = outward.xyz * 2.0 - 1.0;
    normal = vec3(turn * normal.xy / dot(manner.xy, manner.xy), normal.z);
    float tint = fract(manner.z) * 2.0 - 1.0, crowded = floor(manner.z) / 15.0;
    float bough = outward.w * WARM_BOUGH * sin(6.2831853 * (sprig_at.w * 3.0 + manner.z));
    vec3 warm = mix(vec3(0.80, 0.90, 0.94), vec3(1.24, 1.10, 0.82), 0.5 + 0.5 * clamp(tint + bough, -1.0, 1.0));
    vec3 own = colour.rgb * colour.rgb * mix(vec3(1.0), warm * (1.0 + 0.5 * bough), 0.25 + 0.75 * outward.w);
    float deep = crowded * DEEP_SHADE * (1.0 - smoothstep(0.1, 0.85, place.z));
    float sun = ground.y, sky = ground.z * (1.0 - deep);
#if SHADE_MAPS == 0
    // Without maps of their shadows, plants shade themselves and each other by what is known of them.
    float under = 1.0 - smoothstep(0.35, 0.95, place.z);
    sun *= mix(0.15 + 0.85 * colour.a * colour.a, 1.0, 0.25) * (1.0 - CROWD_SHADE * crowded * under);
#elif FAR
    // By its own leaves, as no map is asked within a plant; alone its flanks are in the sun too.
    sun *= smoothstep(SHADED * crowded, mix(LIT_ALONE, LIT, crowded), colour.a);
#endif
#if FAR
    sun *= mix(veil.w, clear.w, smoothstep(0.3, 0.8, place.z));
    vec3 lit = leaf_light(own, normalize(normal), outward.w, normalize(point), sun, sky, colour.a);
    seen = veil.rgb + clear.rgb * lit;
#else
    position = point;
    leaf_normal = vec4(normal, outward.w);
    albedo = own;
    light = vec3(sun, sky, colour.a);
    cut = sprig_at.xyz;
#endif
    gl_Position = draw_of(gl_VertexID / 3, manner.z) < manner.w ? to_clip * vec4(point, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
}
