#version 430 core
// A plant as the sun sees it.
#include "render/frame.glsl"

uniform vec3 anchor;
uniform int map; // 0 near, 1 far

in vec3 place;
in vec4 stand;
in vec4 manner;

void main()
{
    mat2 turn = mat2(manner.x, manner.y, -manner.y, manner.x);
    vec3 position = anchor + stand.xyz + stand.w * vec3(turn * place.xy, place.z);
    gl_Position = to_shade[map] * vec4(position, 1.0);
}
