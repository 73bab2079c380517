#version 430 core
// Vertices of the approximation's squares of TILE_QUADS² quads.
#include "render/frame.glsl"
#include "render/draped_smooth.glsl"

in vec4 square; // west and north from the eye, width of a quad, m; layer of the window
in vec3 window; // of the square in its window: west, north, width in widths of that

out vec2 in_window;
flat out float window_layer;

void main()
{
    uint side = uint(TILE_QUADS + 1), number = uint(gl_VertexID);
    in_window = window.xy + window.z * vec2(number % side, number / side) / float(TILE_QUADS);
    window_layer = square.w;
    gl_Position = to_clip * vec4(smooth_vertex(square, number), 1.0);
}
