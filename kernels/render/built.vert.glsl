#version 430 core
// A vertex of a bridge, tunnel, house or wall.
//   FAR  1: lit here, for lit.frag.glsl
#include "render/built.glsl"

uniform vec3 anchor; // of all vertices, relative to the eye, m

in vec3 local_position; // m from the anchor
in vec4 local_normal;   // xyz: normal, 0..1 for -1..1; w: half the tone
in vec4 vertex_colour;  // rgb: √albedo; w: whether it has one
in vec2 vertex_uv;      // m
in vec2 vertex_look;    // layer, and what lies on it, as in built_radiance

#if FAR
out vec3 seen; // radiance
#else
out vec3 position;
out vec3 normal;
out vec4 colour;
out float tone;
out vec2 uv;
flat out vec2 look;
#endif

void main()
{
    vec3 at = anchor + local_position;
    vec3 n = local_normal.xyz * 2.0 - 1.0;
    float dim = 2.0 * local_normal.w;
#if FAR
    vec2 plain = vec2(vertex_look.x, 0.0);
    seen = built_radiance(at, normalize(n), vertex_colour, dim, plain, vec2(0.0), vec2(0.0));
#else
    position = at;
    normal = n;
    colour = vertex_colour;
    tone = dim;
    uv = vertex_uv;
    look = vertex_look;
#endif
    gl_Position = to_clip * vec4(at, 1.0);
}
