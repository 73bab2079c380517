// One material of the terrain from its textures, at the scales that suit the distance.
//
// Macros of render/shading.py:
//   PLANES  1 or 2: number of projection planes, nearest to the normal
//   SIZES   1 or 2: number of octaves, nearest to the distance
//   HEXES   1 or 3: number of shifted hexagons, which hide the repetition
//   DETAIL  0: neither relief nor fine structure of colours
// and of render/textures.py:
//   LAYERS            number of texture layers
//   IS_BEDDED(layer)  whether its faces have level beds
// Loops end early: CPU drivers leave them when no pixel of a group continues.
#include "render/hex_tiling.glsl"
#include "render/roughness.glsl"

uniform sampler2DArray material_colour; // √albedo, height
uniform sampler2DArray material_relief; // normal x and y, roughness, openness
uniform vec2 phases[LAYERS * 3 * OCTAVES]; // texture coordinates of the eye by layer, plane (yz, xz, xy) and octave
uniform vec4 texture_tiling[LAYERS];       // texture width, m; finest and coarsest octave; rotation per octave, rad
uniform float max_rotations[LAYERS];       // of hexagons, rad

const float RATIO = 3.7;         // width ratio of successive octaves
const float FULL_SIZE = 26.0;    // m, distance up to which octave 0 is used
const float OCTAVE_SLOPE = 0.93; // slope ratio of successive octaves
const float WEAVE = 48.0;        // pixels of a texture below which its hexagons would show: it fades to its mean
const float COARSEST_LOD = 16.0; // mipmap of one texel
const float LEAST_SHARE = 0.02;  // weight below which a plane or octave is skipped

struct MaterialSample {
    vec3 albedo;
    float height;
    vec3 bump; // offset of the normal
    float roughness;
    float open;
};

const MaterialSample NO_MATERIAL = MaterialSample(vec3(0.0), 0.0, vec3(0.0), 0.0, 0.0);

void accumulate(inout MaterialSample sum, MaterialSample m, float weight, float bump_weight)
{
    sum.albedo += weight * m.albedo;
    sum.height += weight * m.height;
    sum.bump += bump_weight * m.bump;
    sum.roughness += weight * m.roughness;
    sum.open += weight * m.open;
}

MaterialSample mix_materials(MaterialSample a, MaterialSample b, float t)
{
    return MaterialSample(mix(a.albedo, b.albedo, t), mix(a.height, b.height, t), mix(a.bump, b.bump, t),
        mix(a.roughness, b.roughness, t), mix(a.open, b.open, t));
}

struct Plane {
    int axis;
    vec2 place; // m from the eye
};

Plane texture_plane(int axis, vec3 position)
{
    return Plane(axis, axis == 0 ? position.yz : axis == 1 ? position.xz : position.xy);
}

vec2 rotated(vec2 v, float angle)
{
    float c = cos(angle), s = sin(angle);
    return vec2(c * v.x - s * v.y, s * v.x + c * v.y);
}

// One lookup; `bump.xy` has the slopes in the plane's axes.
//   angle  rotation of the texture, rad
MaterialSample sample_texel(int layer, vec2 at, float angle, float lod)
{
#if DETAIL
    vec4 colour = textureLod(material_colour, vec3(at, float(layer)), lod);
    vec4 relief = textureLod(material_relief, vec3(at, float(layer)), lod);
    vec2 n = relief.xy * 2.0 - 1.0;
    vec2 slope = rotated(-n * inversesqrt(max(1.0 - dot(n, n), 0.02)), -angle);
    return MaterialSample(colour.rgb * colour.rgb, colour.a, vec3(slope, 0.0), relief.b, relief.a);
#else
    vec4 colour = textureLod(material_colour, vec3(at, float(layer)), COARSEST_LOD);
    return MaterialSample(colour.rgb * colour.rgb, colour.a, vec3(0.0), 1.0, 1.0);
#endif
}

// A layer at one octave.
//   footprint  width of a pixel on the terrain, m
MaterialSample sample_octave(int layer, Plane p, int octave, float footprint)
{
    float width = texture_tiling[layer].x * pow(RATIO, float(octave));
    float angle = texture_tiling[layer].w * float(octave);
    vec2 uv = rotated(p.place, angle) / width + phases[(layer * 3 + p.axis) * OCTAVES + octave];
    float lod = log2(footprint / width * float(textureSize(material_colour, 0).x)) + max(log2(footprint / width * WEAVE), 0.0);
#if HEXES == 1 || !DETAIL
    MaterialSample sum = sample_texel(layer, uv, angle, lod);
#else
    Hexagons h = hexagons(uv);
    // Beds of a rock face are level.
    float max_rotation = IS_BEDDED(layer) && p.axis == 2 ? PI : max_rotations[layer];
    MaterialSample sum = NO_MATERIAL;
    float total = 0.0, square = 0.0; // square: mean of a slope's square in one direction
    for (int k = 0; k < h.count; ++k) {
        ivec2 id = k == 0 ? h.first : k == 1 ? h.second : h.third;
        vec3 hash = hex_hash(id);
        float rotation = max_rotation * hash.z;
        MaterialSample m = sample_texel(layer, rotated(uv - hex_centre(id), rotation) + hash.xy, angle + rotation, lod);
        float weight = (k == 0 ? h.weight.x : k == 1 ? h.weight.y : h.weight.z) * (0.2 + m.height);
        accumulate(sum, m, weight, weight);
        total += weight;
        square += weight * 0.5 * dot(m.bump, m.bump);
    }
    total = 1.0 / total;
    sum = MaterialSample(sum.albedo * total, sum.height * total, sum.bump * total, sum.roughness * total, sum.open * total);
    // The variance of the hexagons' slopes adds to the roughness of their mean, as in a mipmap.
    sum.roughness = filtered_roughness(sum.roughness, max(square * total - 0.5 * dot(sum.bump, sum.bump), 0.0));
#endif
    sum.bump *= pow(OCTAVE_SLOPE, float(octave));
    return sum;
}

// A layer at the octaves that suit the distance: structure of similar size on the screen, near and far. Slopes of two
// octaves are added as uncorrelated values, so that relief does not fade between them.
//   level  octave as a real number, 0 near the eye
MaterialSample sample_plane(int layer, Plane p, float level, float footprint)
{
    level = clamp(level, texture_tiling[layer].y, texture_tiling[layer].z);
#if SIZES == 1
    return sample_octave(layer, p, int(level + 0.5), footprint);
#else
    int octave = min(int(level), OCTAVES - 2);
    float upper = smoothstep(0.2, 0.8, level - float(octave));
    int first = upper > 1.0 - LEAST_SHARE ? 1 : 0, last = upper < LEAST_SHARE ? 0 : 1;
    MaterialSample sum = NO_MATERIAL;
    for (int k = first; k <= last; ++k) {
        float weight = first == last ? 1.0 : k == 1 ? upper : 1.0 - upper;
        accumulate(sum, sample_octave(layer, p, octave + k, footprint), weight, sqrt(weight));
    }
    return sum;
#endif
}

vec3 world_bump(vec3 n, vec2 slope, int axis)
{
    if (axis == 0) return vec3(0.0, -slope) * sign(n.x);
    if (axis == 1) return vec3(-slope.x, 0.0, -slope.y) * sign(n.y);
    return vec3(-slope, 0.0);
}

// A layer at a position.
//   a, b   normal axes of the two planes
//   share  weight of b
MaterialSample sample_material(int layer, vec3 position, vec3 n, int a, int b, float share, float level, float footprint)
{
#if PLANES == 1
    int axis = share > 0.5 ? b : a;
    MaterialSample only = sample_plane(layer, texture_plane(axis, position), level, footprint);
    only.bump = world_bump(n, only.bump.xy, axis);
    return only;
#else
    int first = share > 1.0 - LEAST_SHARE ? 1 : 0, last = share < LEAST_SHARE ? 0 : 1;
    MaterialSample sum = NO_MATERIAL;
    for (int k = first; k <= last; ++k) {
        int axis = k == 1 ? b : a;
        float weight = first == last ? 1.0 : k == 1 ? share : 1.0 - share;
        MaterialSample m = sample_plane(layer, texture_plane(axis, position), level, footprint);
        m.bump = world_bump(n, m.bump.xy, axis);
        accumulate(sum, m, weight, weight);
    }
    return sum;
#endif
}
