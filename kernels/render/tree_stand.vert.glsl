#version 430 core
// What all of one plant shares, found out once and captured (render/plant_meshes.py): a plant has many vertices.
#include "render/frame.glsl"
#include "render/surface_map.glsl"
#include "render/tree_wind.glsl"

uniform vec3 anchor; // of all plants, relative to the eye, m
uniform vec2 wind;   // where it blows to, m/s, east and north
uniform float clock; // s

in vec4 stand; // xyz: foot, m from the anchor; w: height, m

out vec4 ground; // x: height of the foot over the eye as the ground is drawn, m; y: sun over the bare ground; z: sky over it
out vec4 sway;   // see sway_of

const float SINK = 0.15; // m, feet go so far into the ground

void main()
{
    vec3 foot = anchor + stand.xyz;
    vec2 bare = ground_light(foot.xy).rg;
    ground = vec4(standing_height(foot + vec3(0.0, 0.0, SINK)) - SINK, bare, 0.0);
    sway = sway_of(foot.xy + eye.xy, stand.w, wind, clock);
}
