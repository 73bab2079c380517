#version 430 core
// The ground once more, with a colour a tile.
#include "render/ground.glsl"

in vec4 tint; // of the tile

out vec3 ground_normal;
out vec4 weights_low;
out vec4 weights_high;
out vec2 along; // 0..1 from west to east and from north to south
out vec4 tile_tint;

invariant gl_Position;

void main()
{
    ivec2 place = place_in_tile();
    float share = parent_share(place);
    ground_normal = ground_normal_at(share);
    weights_low = low_weights_at(share);
    weights_high = high_weights_at(share);
    along = vec2(place) / float(TILE_QUADS);
    tile_tint = tint;
    gl_Position = to_clip * vec4(ground_position(place, share), 1.0);
}
