#version 430 core
// First step of draping: what tiles have painted on the approximation of the ground. Layers that filter the colour below
// them do so over ground of a mean albedo, as in exported pictures.
#include "render/frame.glsl"
#include "render/appearance.glsl"

in vec3 from_eye; // m

layout(location = 0) out vec4 colour; // albedo times share, share

const float UNKNOWN_GROUND = 0.2; // as in terrain/appearance.py

void main()
{
    vec3 through, normal = normalize(cross(dFdx(from_eye), dFdy(from_eye)));
    vec4 found = painted(from_eye, normal, trees.z, through);
    colour = vec4(found.rgb * found.a + UNKNOWN_GROUND * (through - (1.0 - found.a)), found.a);
}
