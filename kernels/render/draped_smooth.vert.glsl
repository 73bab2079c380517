#version 430 core
// Vertices of the approximation's squares of TILE_QUADS² quads, or with FEATURES of draped features on their triangles.
#include "render/frame.glsl"
#include "render/draped_smooth.glsl"

in vec4 square; // west and north from the eye, width of a quad, m; layer of the window
in vec4 window; // of the square in its window: west, north, width in widths of that; unused
#if FEATURES
in uvec4 corners; // as in draped_geometry.vert.glsl
in vec2 weights;
in vec2 place;
in uint part;

out vec2 part_place;
out vec3 from_eye;
flat out uint part_number;
#else
out vec2 in_window;
flat out float window_layer;
#endif

vec3 corner(uint number)
{
    uvec2 at = uvec2(number % uint(TILE_QUADS + 1), number / uint(TILE_QUADS + 1));
    vec2 flat_place = square.xy + square.z * vec2(at) * vec2(1.0, -1.0);
    return vec3(flat_place, smooth_height(flat_place));
}

void main()
{
#if FEATURES
    part_place = place;
    part_number = part;
    from_eye = (1.0 - weights.x - weights.y) * corner(corners.x) + weights.x * corner(corners.y)
        + weights.y * corner(corners.z);
    gl_Position = to_clip * vec4(from_eye, 1.0);
#else
    uint side = uint(TILE_QUADS + 1), number = uint(gl_VertexID);
    in_window = window.xy + window.z * vec2(number % side, number / side) / float(TILE_QUADS);
    window_layer = square.w;
    gl_Position = to_clip * vec4(corner(number), 1.0);
#endif
}
