#version 430 core
// A vertex of a draped feature on a drawn triangle: the mean of its corners, which are where ground.vert.glsl has them.
// VERTEX_WORDS: of a vertex of a tile.
#define FETCHED
#include "render/ground.glsl"

layout(std430, binding = 1) readonly buffer TileVertices { uint tile_words[]; };

in uvec4 corners; // numbers of the triangle's vertices in their tile
in vec2 weights;  // of the second and the third
in vec2 place;    // in the part, m
in uint part;
in int slot;      // of the tile

out vec2 part_place;
out vec3 from_eye; // m
flat out uint part_number;

vec3 corner(uint number)
{
    uint word = (uint(slot) * uint(SIDE * SIDE) + number) * uint(VERTEX_WORDS);
    ground = uvec4(tile_words[word], tile_words[word + 1u], 0u, 0u);
    ivec2 at = ivec2(int(number) % SIDE, int(number) / SIDE);
    return ground_position(at, parent_share(at));
}

void main()
{
    part_place = place;
    part_number = part;
    from_eye = (1.0 - weights.x - weights.y) * corner(corners.x) + weights.x * corner(corners.y)
        + weights.y * corner(corners.z);
    clip_to_bounds(from_eye);
    gl_Position = to_clip * vec4(from_eye, 1.0);
}
