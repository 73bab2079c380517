#version 430 core
// One vertex of one tile. A tile is TILE_QUADS² quads, rows from north to south, then a skirt: its four borders
// once more, already lowered, which hides the cracks between levels.
#include "render/frame.glsl"

const int SIDE = TILE_QUADS + 1;
const int VERTICES = SIDE * SIDE + 4 * SIDE;

in float height;     // m
in ivec2 slope;      // x and y of the unit normal, times 32767
in vec4 low_weights; // grass, soil, rock, scree
in vec4 high_weights; // sand, snow, river bed, forest floor
in vec3 corner;      // a tile's: xy of its north-west corner relative to the eye, z: cell size, all in m

out vec3 ground_normal;
out vec4 weights_low;
out vec4 weights_high;

ivec2 place_in_tile(int id)
{
    if (id < SIDE * SIDE) return ivec2(id % SIDE, id / SIDE);
    int along = (id - SIDE * SIDE) % SIDE;
    int border = (id - SIDE * SIDE) / SIDE; // north, south, west, east
    return border == 0 ? ivec2(along, 0) : border == 1 ? ivec2(along, TILE_QUADS)
        : border == 2 ? ivec2(0, along) : ivec2(TILE_QUADS, along);
}

void main()
{
    ivec2 place = place_in_tile(gl_VertexID % VERTICES);
    vec3 position = vec3(corner.xy + vec2(place.x, -place.y) * corner.z, height - eye.z);
    vec2 flat_part = vec2(slope) / 32767.0;
    ground_normal = vec3(flat_part, sqrt(max(1.0 - dot(flat_part, flat_part), 0.0)));
    weights_low = low_weights;
    weights_high = high_weights;
    gl_Position = to_clip * vec4(position, 1.0);
}
