// A vertex of a tile of TILE_QUADS² quads, morphed between the tile's own value and its parent's. Vertices are stored
// in rows from north to south. Oracle: tests/render/ground_model.py and sketchterrain/tiles/lod.py.
//
// Vertex positions depend only on the integer lattice and on values that neighbouring tiles share along their borders,
// in an order of operations that no compiler may change (precise): neighbours compute equal bits, without cracks.
#include "render/frame.glsl"

const int SIDE = TILE_QUADS + 1;

#ifdef FETCHED
uvec4 ground; // of the vertex whose position is asked for, by render/draped_geometry.vert.glsl
#else
// Few wide attributes: on a CPU driver the cost is per attribute, not per component.
in uvec4 ground;       // height of the tile and of its parent's triangles, m; x and y of the two normals
in uvec4 weight_words; // of the materials, WEIGHT_WORDS of the tile, then as many of its parent, four weights a word
#if WEIGHT_WORDS > 2
in uvec4 more_words;
#endif
out vec3 ground_normal;
out vec4 material_weights[WEIGHT_WORDS];
#endif

// Per tile.
in ivec4 tile_corner; // north-west corner, lattice units east and north of the eye's cell; units per quad; w: see below
in vec4 morph_west;   // parent share at the north-west, west, south-west and north
in vec4 morph_east;   // parent share at the north-east, east, south-east and south; at the centre: tile_corner.w

invariant gl_Position;

uniform float metres_per_unit;
uniform vec2 eye_fraction; // offset of the eye in its lattice cell, m

#ifdef BOUNDED
uniform vec4 bounds; // west, south, east, north of the terrain, relative to the eye, m
out float gl_ClipDistance[4];
#endif

ivec2 place_in_tile()
{
    int id = gl_VertexID % (SIDE * SIDE);
    return ivec2(id % SIDE, id / SIDE);
}

// Share of the parent: from the border's control value to the centre's within a quarter of the tile.
float parent_share(ivec2 place)
{
    ivec2 inward = min(place, TILE_QUADS - place);
    precise vec2 t = min(vec2(inward) * (4.0 / float(TILE_QUADS)), 1.0);
    vec3 border = 2 * place.x < TILE_QUADS ? morph_west.xyz : morph_east.xyz;
    vec3 middle = vec3(morph_west.w, intBitsToFloat(tile_corner.w), morph_east.w);
    precise vec3 along = (1.0 - t.x) * border + t.x * middle;
    float end = 2 * place.y < TILE_QUADS ? along.x : along.z;
    precise float share = (1.0 - t.y) * end + t.y * along.y;
    return share;
}

// Relative to the eye, m.
vec3 ground_position(ivec2 place, float share)
{
    ivec2 units = tile_corner.xy + ivec2(place.x, -place.y) * tile_corner.z;
    precise vec2 flat_place = vec2(units) * metres_per_unit - eye_fraction;
    precise float level = (1.0 - share) * uintBitsToFloat(ground.x) + share * uintBitsToFloat(ground.y);
    precise float up = level - eye.z;
    return vec3(flat_place, up);
}

// Clip to the bounds of a finite world.
void clip_to_bounds(vec3 position)
{
#ifdef BOUNDED
    gl_ClipDistance[0] = position.x - bounds.x;
    gl_ClipDistance[1] = position.y - bounds.y;
    gl_ClipDistance[2] = bounds.z - position.x;
    gl_ClipDistance[3] = bounds.w - position.y;
#endif
}

#ifndef WOODED
#define WOODED(w) 0.0
#endif
const float CANOPY_HEIGHT = 11.0;        // m, of a full forest
const vec2 CANOPY_RISES = vec2(0.75, 1.1); // of the plants' draw distance, where it rises as they vanish

// Height (m) of a distant forest's canopy over the ground at a position, so that its outline and its edges stay.
//   wooded  weight of the ground under trees
float canopy_lift(float wooded, vec3 position)
{
    if (trees.w <= 0.0) return 0.0;
    return CANOPY_HEIGHT * wooded * smoothstep(CANOPY_RISES.x, CANOPY_RISES.y, length(position) / trees.w);
}

#ifndef FETCHED
vec3 ground_normal_at(float share)
{
    precise vec2 flat_part = (1.0 - share) * unpackSnorm2x16(ground.z) + share * unpackSnorm2x16(ground.w);
    return vec3(flat_part, sqrt(max(1.0 - dot(flat_part, flat_part), 0.0)));
}

uint weight_word(int k)
{
#if WEIGHT_WORDS > 2
    return k < 4 ? weight_words[k] : more_words[k - 4];
#else
    return weight_words[k];
#endif
}

// Output the weights of the materials.
void emit_weights(float share)
{
    for (int k = 0; k < WEIGHT_WORDS; ++k)
        material_weights[k] = mix(unpackUnorm4x8(weight_word(k)), unpackUnorm4x8(weight_word(WEIGHT_WORDS + k)), share);
}

// Output the vertex with all attributes; return its position in the tile.
ivec2 emit_vertex()
{
    ivec2 place = place_in_tile();
    float share = parent_share(place);
    ground_normal = ground_normal_at(share);
    emit_weights(share);
    vec3 position = ground_position(place, share);
    clip_to_bounds(position);
    position.z += canopy_lift(WOODED(material_weights), position);
    gl_Position = to_clip * vec4(position, 1.0);
    return place;
}
#endif
