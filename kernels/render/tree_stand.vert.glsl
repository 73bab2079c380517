#version 430 core
// Attributes shared by a plant's vertices, captured by transform feedback (render/plant_meshes.py).
//   FAR 1: also shadows and aerial perspective, for a plant that is lit at its vertices
#include "render/frame.glsl"
#include "render/surface_map.glsl"
#include "render/tree_wind.glsl"
#if FAR
#include "render/shade.glsl"
#include "render/clouds.glsl"
#endif

uniform vec3 anchor; // of all plants, relative to the eye, m
uniform vec2 wind;   // where it blows to, m/s, east and north
uniform float clock; // s

in vec4 foot_height; // xyz: foot, m from the anchor; w: height, m

out vec4 ground; // x: height of the displayed ground at the foot over the eye, m; y: its sun visibility; z: sky visibility
out vec4 sway;   // see sway_of
#if FAR
out vec4 veil;   // rgb: in-scattered light; w: sun visibility of its lower half, relative to the ground's
out vec4 clear;  // rgb: transmittance of the air; w: as veil's, of its upper half
#endif

const float SINK = 0.15; // m, depth of feet below the ground
#if FAR
const vec2 HALVES = vec2(0.45, 0.80);  // of the height, where shadow maps are sampled …
const vec2 TOWARDS = vec2(0.35, 0.25); // … offset towards the sun (heights), against self-shadowing
#endif

void main()
{
    vec3 foot = anchor + foot_height.xyz;
    vec2 bare = ground_light(foot.xy).rg;
    ground = vec4(standing_height(foot + vec3(0.0, 0.0, SINK)) - SINK, bare, 0.0);
    sway = sway_of(foot.xy + eye.xy, foot_height.w, wind, clock);
#if FAR
    foot.z = ground.x;
    vec3 middle = foot + vec3(0.0, 0.0, 0.5 * foot_height.w);
    vec3 added = through_air(vec3(0.0), middle);
    float clouds = cloud_shadow(middle);
    float halves[2];
    for (int k = 0; k < 2; ++k)
        halves[k] = clouds * tree_shade(foot + foot_height.w * (vec3(0.0, 0.0, HALVES[k]) + TOWARDS[k] * to_sun.xyz), vec3(0.0));
    veil = vec4(added, halves[0]);
    clear = vec4(through_air(vec3(1.0), middle) - added, halves[1]);
#endif
}
