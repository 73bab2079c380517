#version 430 core
// A vertex of a plant. Cross-fading plants lose their triangles one by one.
//   FAR 1: lit here, as a triangle is about as large as a pixel; else in tree.frag.glsl
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

in vec3 local_position; // plant heights, from its foot
in vec4 local_normal;   // xyz: normal, 0..1 for -1..1; w: 1 leaf, 0 wood
in vec4 vertex_colour;  // rgb: √albedo, a: openness to the sky
in vec4 leaf_uv;        // xy: position on its spray, 0..1; z: alpha mask; w: phase of its bough
in vec4 foot_height;    // xyz: foot, m from the anchor; w: height, m
in vec4 ground;         // see tree_stand.vert.glsl
in vec4 sway;
#if FAR
in vec4 veil;
in vec4 clear;
#endif
in vec4 appearance;     // xy: cosine and sine of its rotation times its width scale; z: variation; w: visible share

#if FAR
out vec3 seen; // radiance
#else
out vec3 position;
out vec4 leaf_normal; // w: 1 leaf, 0 wood
out vec3 albedo;
out vec3 light; // x: sun visibility of the ground; y: sky visibility among other plants; z: openness of the crown
out vec3 spray; // xy: position on its spray, 0..1; z: alpha mask
flat out uint spray_random;
#endif

const float DEEP_SHADE = 0.55;   // sky light absorbed by a dense forest at its floor
const float CROWD_SHADE = 0.75;  // sunlight absorbed by a dense forest low down, without shadow maps
const float SHADED = 0.30, LIT = 0.80; // openness within a forest's crown at which direct sun begins and is full
const float LIT_ALONE = 0.50;    // the latter for a solitary plant
const float WARM_BOUGH = 0.16;   // colour variation of boughs

// Random number 0..1 of a triangle of a plant.
float triangle_random(int triangle, float variation)
{
    uint h = uint(triangle) * 0x9e3779b9u ^ floatBitsToUint(variation);
    h ^= h >> 16; h *= 0x7feb352du; h ^= h >> 15;
    return float(h & 0xffffu) / 65536.0;
}

void main()
{
    mat2 turn = mat2(appearance.x, appearance.y, -appearance.y, appearance.x);
    vec3 foot = vec3(anchor.xy + foot_height.xy, ground.x);
    vec3 at = vec3(turn * local_position.xy, local_position.z);
    vec3 point = foot + foot_height.w * at + swayed(at, foot_height.w, sway, leaf_uv.w, local_normal.w, clock);
    vec3 normal = local_normal.xyz * 2.0 - 1.0;
    normal = vec3(turn * normal.xy / dot(appearance.xy, appearance.xy), normal.z);
    float tint = fract(appearance.z) * 2.0 - 1.0, crowded = floor(appearance.z) / 15.0;
    float bough = local_normal.w * WARM_BOUGH * sin(6.2831853 * (leaf_uv.w * 3.0 + appearance.z));
    vec3 warm = mix(vec3(0.80, 0.90, 0.94), vec3(1.24, 1.10, 0.82), 0.5 + 0.5 * clamp(tint + bough, -1.0, 1.0));
    vec3 own = vertex_colour.rgb * vertex_colour.rgb * mix(vec3(1.0), warm * (1.0 + 0.5 * bough), 0.25 + 0.75 * local_normal.w);
    float deep = crowded * DEEP_SHADE * (1.0 - smoothstep(0.1, 0.85, local_position.z));
    float sun = ground.y, sky = ground.z * (1.0 - deep);
#if SHADE_MAPS == 0
    // Without shadow maps, shading is estimated from openness and crowding.
    float under = 1.0 - smoothstep(0.35, 0.95, local_position.z);
    sun *= mix(0.15 + 0.85 * vertex_colour.a * vertex_colour.a, 1.0, 0.25) * (1.0 - CROWD_SHADE * crowded * under);
#elif FAR
    // Self-shadowing from openness, as shadow maps are sampled once a plant; a solitary one is lit on its flanks too.
    sun *= smoothstep(SHADED * crowded, mix(LIT_ALONE, LIT, crowded), vertex_colour.a);
#endif
#if FAR
    sun *= mix(veil.w, clear.w, smoothstep(0.3, 0.8, local_position.z));
    vec3 lit = leaf_light(own, normalize(normal), local_normal.w, normalize(point), sun, sky, vertex_colour.a);
    seen = veil.rgb + clear.rgb * lit;
#else
    position = point;
    leaf_normal = vec4(normal, local_normal.w);
    albedo = own;
    light = vec3(sun, sky, vertex_colour.a);
    spray = leaf_uv.xyz;
    spray_random = uint(dot(local_normal.xyz, 255.0 * vec3(37.0, 91.0, 151.0)) + 0.5) & 255u;
#endif
    gl_Position = triangle_random(gl_VertexID / 3, appearance.z) < appearance.w ? to_clip * vec4(point, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
}
