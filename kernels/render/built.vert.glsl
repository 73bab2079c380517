#version 430 core
// A vertex of a bridge, tunnel, house or wall.
#include "render/frame.glsl"

uniform vec3 anchor; // of all vertices, relative to the eye, m

in vec3 local_position; // m from the anchor
in vec4 local_normal;   // xyz: normal, 0..1 for -1..1; w: half the tone
in vec4 vertex_colour;  // rgb: √albedo; w: whether it has one
in vec2 vertex_uv;      // m
in vec2 vertex_look;    // layer, and m between railway tracks

out vec3 position;
out vec3 normal;
out vec4 colour;
out float tone;
out vec2 uv;
flat out vec2 look;

void main()
{
    position = anchor + local_position;
    normal = local_normal.xyz * 2.0 - 1.0;
    colour = vertex_colour;
    tone = 2.0 * local_normal.w;
    uv = vertex_uv;
    look = vertex_look;
    gl_Position = to_clip * vec4(position, 1.0);
}
