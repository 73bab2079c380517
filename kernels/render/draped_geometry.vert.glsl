#version 430 core
// A vertex of a draped feature on a triangle: the mean of its corners.
//   VERTEX_WORDS  of a vertex of a drawn tile, as in ground.vert.glsl
#include "render/frame.glsl"
#define FETCHED
#include "render/ground.glsl"
layout(std430, binding = 1) readonly buffer TileVertices { uint tile_words[]; };
in int slot; // of the tile

in uvec4 corners; // numbers of the triangle's vertices in their square or tile
in vec2 weights;  // of the second and the third
in vec2 place;    // in the part, m
in uint part;

out vec2 part_place;
out vec3 from_eye; // m
flat out uint part_number;

vec3 corner(uint number)
{
    uint word = (uint(slot) * uint(SIDE * SIDE) + number) * uint(VERTEX_WORDS);
    ground = uvec4(tile_words[word], tile_words[word + 1u], 0u, 0u);
    ivec2 at = ivec2(int(number) % SIDE, int(number) / SIDE);
    float share = parent_share(at);
    vec3 position = ground_position(at, share);
    vec4 w[WEIGHT_WORDS];
    for (uint k = 0u; k < uint(WEIGHT_WORDS); ++k)
        w[k] = mix(unpackUnorm4x8(tile_words[word + 4u + k]), unpackUnorm4x8(tile_words[word + 4u + uint(WEIGHT_WORDS) + k]), share);
    position.z += canopy_lift(WOODED(w), position);
    return position;
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
