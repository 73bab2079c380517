#version 430 core
// Terrain vertices with a tint per tile.
#include "render/ground.glsl"

in vec4 tint; // of the tile

out vec2 along; // 0..1 from west to east and from north to south
out vec4 tile_tint;

void main()
{
    along = vec2(emit_vertex()) / float(TILE_QUADS);
    tile_tint = tint;
}
