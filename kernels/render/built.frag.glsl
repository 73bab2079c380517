#version 430 core
// A bridge, tunnel, house or wall, lit as the ground.
#include "render/built.glsl"

in vec3 position;
in vec3 normal;
in vec4 colour;
in float tone;
in vec2 uv;
flat in vec2 look;
out vec4 radiance;

void main()
{
    radiance = vec4(built_radiance(position, normalize(normal), colour, tone, look, uv, fwidth(uv)), 1.0);
}
