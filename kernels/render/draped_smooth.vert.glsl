#version 430 core
// Vertices of the approximation's squares of TILE_QUADS² quads, by rows from north to south.
#include "render/frame.glsl"
#include "render/draped_smooth.glsl"

in vec3 square; // west and north from the eye, width of a quad, m

out vec3 from_eye; // m

void main()
{
    uint side = uint(TILE_QUADS + 1), number = uint(gl_VertexID);
    vec2 place = square.xy + square.z * vec2(number % side, number / side) * vec2(1.0, -1.0);
    from_eye = vec3(place, smooth_height(place));
    gl_Position = to_clip * vec4(from_eye, 1.0);
}
