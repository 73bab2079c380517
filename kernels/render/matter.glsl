// What the ground is made of at a place: one material from its textures, laid at the sizes that suit the distance.
//
// Set by render/shading.py:
//   PLANES  1 or 2: a place is textured from the planes that its normal is nearest to
//   SIZES   1 or 2: from the sizes that suit its distance
//   HEXES   1 or 3: from shifted hexagons, so that no repetition shows
//   DETAIL  0: neither relief nor the fine structure of colours
// Loops run as far as a place needs: a driver that runs on the CPU ends them where none of a few pixels goes on.
#include "render/hex_tiling.glsl"
#include "render/roughness.glsl"

uniform sampler2DArray material_colour; // √albedo, height
uniform sampler2DArray material_relief; // normal x and y, roughness, openness
uniform vec2 phases[9 * 3 * OCTAVES];   // where the eye lies in a layer's texture, by plane (yz, xz, xy) and octave
uniform vec4 laid[9];                   // width of a layer's texture, m; finest and coarsest octave; turn of each, rad
uniform float spins[9];                 // by how much hexagons may turn, rad

const float RATIO = 3.7;        // of one octave's width to the next
const float FULL_SIZE = 26.0;   // m, distance up to which octave 0 suits
const float FLATTER = 0.93;     // slopes of an octave over those of the one below
const float ALL_BLURRED = 16.0; // a mipmap of one texel
const float LEAST_SHARE = 0.02; // of a plane or a size that is read
#define ROCK 2

struct Matter {
    vec3 albedo;
    float height;
    vec3 bump; // to be added to the normal
    float roughness;
    float open;
};

const Matter NO_MATTER = Matter(vec3(0.0), 0.0, vec3(0.0), 0.0, 0.0);

void put(inout Matter sum, Matter m, float weight, float bump_weight)
{
    sum.albedo += weight * m.albedo;
    sum.height += weight * m.height;
    sum.bump += bump_weight * m.bump;
    sum.roughness += weight * m.roughness;
    sum.open += weight * m.open;
}

Matter lerp(Matter a, Matter b, float t)
{
    return Matter(mix(a.albedo, b.albedo, t), mix(a.height, b.height, t), mix(a.bump, b.bump, t),
        mix(a.roughness, b.roughness, t), mix(a.open, b.open, t));
}

struct Plane {
    int axis;
    vec2 place; // m from the eye
};

Plane plane_of(int axis, vec3 position)
{
    return Plane(axis, axis == 0 ? position.yz : axis == 1 ? position.xz : position.xy);
}

vec2 turned(vec2 v, float angle)
{
    float c = cos(angle), s = sin(angle);
    return vec2(c * v.x - s * v.y, s * v.x + c * v.y);
}

// One look-up; its slopes stand in the first two parts of `bump`, in the plane's own directions.
//   angle  by which the texture was turned, rad
Matter texel_of(int layer, vec2 at, float angle, float lod)
{
#if DETAIL
    vec4 colour = textureLod(material_colour, vec3(at, float(layer)), lod);
    vec4 relief = textureLod(material_relief, vec3(at, float(layer)), lod);
    vec2 n = relief.xy * 2.0 - 1.0;
    vec2 slope = turned(-n * inversesqrt(max(1.0 - dot(n, n), 0.02)), -angle);
    return Matter(colour.rgb * colour.rgb, colour.a, vec3(slope, 0.0), relief.b, relief.a);
#else
    vec4 colour = textureLod(material_colour, vec3(at, float(layer)), ALL_BLURRED);
    return Matter(colour.rgb * colour.rgb, colour.a, vec3(0.0), 1.0, 1.0);
#endif
}

//   footprint: width of a pixel on the ground, m
Matter at_octave(int layer, Plane p, int octave, float footprint)
{
    float width = laid[layer].x * pow(RATIO, float(octave));
    float angle = laid[layer].w * float(octave);
    vec2 uv = turned(p.place, angle) / width + phases[(layer * 3 + p.axis) * OCTAVES + octave];
    float lod = log2(footprint / width * float(textureSize(material_colour, 0).x));
#if HEXES == 1 || !DETAIL
    Matter sum = texel_of(layer, uv, angle, lod);
#else
    Hexagons h = hexagons(uv);
    // The beds of a rock face lie level.
    float spin = layer == ROCK && p.axis == 2 ? PI : spins[layer];
    Matter sum = NO_MATTER;
    float total = 0.0, square = 0.0; // square: mean of a slope's square in one direction
    for (int k = 0; k < h.count; ++k) {
        ivec2 id = k == 0 ? h.first : k == 1 ? h.second : h.third;
        vec3 chance = hex_chance(id);
        float turn = spin * chance.z;
        Matter m = texel_of(layer, turned(uv - hex_middle(id), turn) + chance.xy, angle + turn, lod);
        float weight = (k == 0 ? h.weight.x : k == 1 ? h.weight.y : h.weight.z) * (0.2 + m.height);
        put(sum, m, weight, weight);
        total += weight;
        square += weight * 0.5 * dot(m.bump, m.bump);
    }
    total = 1.0 / total;
    sum = Matter(sum.albedo * total, sum.height * total, sum.bump * total, sum.roughness * total, sum.open * total);
    // What differs between the hexagons' slopes is roughness of their mean, as in a mipmap.
    sum.roughness = filtered_roughness(sum.roughness, max(square * total - 0.5 * dot(sum.bump, sum.bump), 0.0));
#endif
    sum.bump *= pow(FLATTER, float(octave));
    return sum;
}

// A layer at the octaves that suit the distance: structure of about one size on the screen, near and far. Where two
// octaves meet, their slopes are added as what has nothing to do with each other is, so that relief does not fade.
//   level  of octaves, 0 near the eye
Matter from_plane(int layer, Plane p, float level, float footprint)
{
    level = clamp(level, laid[layer].y, laid[layer].z);
#if SIZES == 1
    return at_octave(layer, p, int(level + 0.5), footprint);
#else
    int octave = min(int(level), OCTAVES - 2);
    float upper = smoothstep(0.2, 0.8, level - float(octave));
    int first = upper > 1.0 - LEAST_SHARE ? 1 : 0, last = upper < LEAST_SHARE ? 0 : 1;
    Matter sum = NO_MATTER;
    for (int k = first; k <= last; ++k) {
        float weight = first == last ? 1.0 : k == 1 ? upper : 1.0 - upper;
        put(sum, at_octave(layer, p, octave + k, footprint), weight, sqrt(weight));
    }
    return sum;
#endif
}

vec3 bump_of(vec3 n, vec2 slope, int axis)
{
    if (axis == 0) return vec3(0.0, -slope) * sign(n.x);
    if (axis == 1) return vec3(-slope.x, 0.0, -slope.y) * sign(n.y);
    return vec3(-slope, 0.0);
}

// A layer at a place.
//   a, b   planes by the axis that stands on them
//   share  of b
Matter matter_at(int layer, vec3 position, vec3 n, int a, int b, float share, float level, float footprint)
{
#if PLANES == 1
    int axis = share > 0.5 ? b : a;
    Matter only = from_plane(layer, plane_of(axis, position), level, footprint);
    only.bump = bump_of(n, only.bump.xy, axis);
    return only;
#else
    int first = share > 1.0 - LEAST_SHARE ? 1 : 0, last = share < LEAST_SHARE ? 0 : 1;
    Matter sum = NO_MATTER;
    for (int k = first; k <= last; ++k) {
        int axis = k == 1 ? b : a;
        float weight = first == last ? 1.0 : k == 1 ? share : 1.0 - share;
        Matter m = from_plane(layer, plane_of(axis, position), level, footprint);
        m.bump = bump_of(n, m.bump.xy, axis);
        put(sum, m, weight, weight);
    }
    return sum;
#endif
}
