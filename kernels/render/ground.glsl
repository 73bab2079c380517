// A vertex of a tile, between what the tile itself and what its parent shows there. A tile is TILE_QUADS² quads, its
// vertices stand in rows from north to south. Oracle: tests/render/ground_model.py and sketchterrain/tiles/morph.py.
//
// Whatever decides where a vertex lies is a function of its place on the integer lattice and of values that tiles
// share along their borders, in an order of operations that no compiler may change: so neighbours compute the same
// bits, and nothing opens between them.
#include "render/frame.glsl"

const int SIDE = TILE_QUADS + 1;

in float height;        // m, the tile's own
in float parent_height; // m, what its parent's triangles show here
in ivec2 slope;         // x and y of the unit normal, times 32767
in ivec2 parent_slope;
in vec4 low_weights;  // grass, soil, rock, scree
in vec4 high_weights; // sand, snow, river bed, forest floor
in vec4 parent_low_weights;
in vec4 parent_high_weights;

// Of the tile.
in ivec2 corner;        // north-west, lattice units east and north of the eye's place on the lattice
in int step_units;      // lattice units a quad
in vec3 morph_west;     // how much of the parent is shown: north, middle, south
in vec3 morph_middle;
in vec3 morph_east;

uniform float metres_per_unit;
uniform vec2 eye_fraction; // of the eye, beyond its place on the lattice, m

ivec2 place_in_tile()
{
    int id = gl_VertexID % (SIDE * SIDE);
    return ivec2(id % SIDE, id / SIDE);
}

// From a border's control to the centre's within a quarter of the tile.
float parent_share(ivec2 place)
{
    ivec2 inward = min(place, TILE_QUADS - place);
    precise vec2 t = min(vec2(inward) * (4.0 / float(TILE_QUADS)), 1.0);
    vec3 border = 2 * place.x < TILE_QUADS ? morph_west : morph_east;
    precise vec3 along = (1.0 - t.x) * border + t.x * morph_middle;
    float end = 2 * place.y < TILE_QUADS ? along.x : along.z;
    precise float share = (1.0 - t.y) * end + t.y * along.y;
    return share;
}

// Relative to the eye, m.
vec3 ground_position(ivec2 place, float share)
{
    ivec2 units = corner + ivec2(place.x, -place.y) * step_units;
    precise vec2 flat_place = vec2(units) * metres_per_unit - eye_fraction;
    precise float level = (1.0 - share) * height + share * parent_height;
    precise float up = level - eye.z;
    return vec3(flat_place, up);
}

vec3 ground_normal_at(float share)
{
    precise vec2 flat_part = ((1.0 - share) * vec2(slope) + share * vec2(parent_slope)) / 32767.0;
    return vec3(flat_part, sqrt(max(1.0 - dot(flat_part, flat_part), 0.0)));
}
