#version 430 core
// A line as two triangles (six vertices) of constant width on the screen.
#include "render/frame.glsl"

in vec3 from;  // m from the anchor
in vec3 to;
in vec4 colour;

uniform vec3 anchor; // m from the eye
uniform vec2 size;   // of the framebuffer, px
uniform float width; // px
uniform float nearer; // depth offset, as share of the distance to the eye

out vec4 line_colour;

const float NEAREST = 1e-3; // clip w: the part behind the eye is cut off here

void main()
{
    vec4 a = to_clip * vec4((from + anchor) * (1.0 - nearer), 1.0);
    vec4 b = to_clip * vec4((to + anchor) * (1.0 - nearer), 1.0);
    vec4 first = a.w >= NEAREST ? a : mix(a, b, clamp((NEAREST - a.w) / (b.w - a.w), 0.0, 1.0));
    vec4 last = b.w >= NEAREST ? b : mix(b, a, clamp((NEAREST - b.w) / (a.w - b.w), 0.0, 1.0));
    bool behind = a.w < NEAREST && b.w < NEAREST;
    vec2 direction = (last.xy / last.w - first.xy / first.w) * size;
    vec2 across = vec2(-direction.y, direction.x) / max(length(direction), 1e-6);
    int corner = int[6](0, 1, 2, 2, 1, 3)[gl_VertexID];
    vec4 here = corner < 2 ? first : last;
    float side = (corner & 1) == 0 ? -1.0 : 1.0;
    here.xy += side * across * width / size * here.w;
    line_colour = colour;
    gl_Position = behind ? vec4(0.0, 0.0, 2.0, 1.0) : here;
}
