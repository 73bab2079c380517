#version 430 core
// What all of one plant shares, found out once and captured (render/plant_meshes.py): a plant has many vertices.
//   FAR 1: its shade and the air before it too, for a plant that is lit at its vertices
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

in vec4 stand; // xyz: foot, m from the anchor; w: height, m

out vec4 ground; // x: height of the foot over the eye as the ground is drawn, m; y: sun over the bare ground; z: sky over it
out vec4 sway;   // see sway_of
#if FAR
out vec4 veil;   // rgb: light that the air adds; w: share of the bare ground's sun that reaches its lower half
out vec4 clear;  // rgb: share of its light that comes through the air; w: as veil's, of its upper half
#endif

const float SINK = 0.15; // m, feet go so far into the ground
#if FAR
const vec2 HALVES = vec2(0.45, 0.80);  // of the height, where the sun is asked for …
const vec2 TOWARDS = vec2(0.35, 0.25); // … and heights that this is moved towards it: a crown does not shade itself
#endif

void main()
{
    vec3 foot = anchor + stand.xyz;
    vec2 bare = ground_light(foot.xy).rg;
    ground = vec4(standing_height(foot + vec3(0.0, 0.0, SINK)) - SINK, bare, 0.0);
    sway = sway_of(foot.xy + eye.xy, stand.w, wind, clock);
#if FAR
    foot.z = ground.x;
    vec3 middle = foot + vec3(0.0, 0.0, 0.5 * stand.w);
    vec3 added = through_air(vec3(0.0), middle);
    float clouds = cloud_shadow(middle);
    float halves[2];
    for (int k = 0; k < 2; ++k)
        halves[k] = clouds * tree_shade(foot + stand.w * (vec3(0.0, 0.0, HALVES[k]) + TOWARDS[k] * to_sun.xyz), vec3(0.0));
    veil = vec4(added, halves[0]);
    clear = vec4(through_air(vec3(1.0), middle) - added, halves[1]);
#endif
}
