#version 430 core
// Deferred shading of the terrain: height-blended materials (Zaaijer 2013, §5.4), lit by sun and sky, through the air.
//
// A CPU driver executes both sides of every branch, so the cost is fixed by macros (render/shading.py):
//   MATERIALS  1 to 3: number of blended materials; with one, a single noise lookup replaces three
//   PLANES, SIZES, HEXES, DETAIL  texturing of each material, render/matter.glsl
//   WEIGHT_WORDS, DISTANT_LAYER(layer)  of the sketch's materials, render/material_macros.py
//   SHADE_MAPS 0, 1 or 2: shadow maps of the plants
//   SAMPLES    along each axis of a pixel
//   APPEARANCE samples of what vectors paint (appearance.glsl); 0: nothing is painted
//   DRAPED     whether more is drawn over it (render/draped.py)
#include "render/frame.glsl"
#include "render/gbuffer.glsl"
#include "render/surface.glsl"
#include "render/triplanar.glsl"
#include "render/height_blend.glsl"
#include "render/matter.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#include "render/variety.glsl"
#include "render/lit_material.glsl"
#ifndef DRAPED
#define DRAPED 0
#endif
#define COVERED (APPEARANCE || DRAPED)
#if APPEARANCE
#include "render/appearance.glsl"
#endif

uniform sampler2D gbuffer_depth; // SAMPLES² samples a pixel, ground.frag.glsl
uniform sampler2D gbuffer_normal;
uniform sampler2D gbuffer_weights[WEIGHT_WORDS];

layout(location = 0) out vec4 radiance; // w: depth of the sample that was shaded

vec3 position; // of the shaded point, m from the eye
#if DRAPED
uniform sampler2D draped; // rgb: albedo times the share; a: share
#endif
bool is_canopy; // beyond the trees
float canopy;   // share of the shaded point that is a distant forest's
#if COVERED
float grain; // brightness of the textures over their mean, which what is painted keeps
#endif

uniform vec3 means[LAYERS]; // mean albedo of the layers
#if MATERIALS == 1
const float SOFT_BORDER = 0.6; // difference of weights over which two materials exchange their mean colours
#endif
const vec2 CANOPY_FROM = vec2(0.78, 0.22);            // of the trees' distance, where crowns replace their ground; spread
const vec3 CANOPY_TONE = vec3(2.25, 1.80, 1.95);    // of leaves over the texture's, which has the shade between crowns
const vec3 CONIFERS = vec3(0.76, 0.80, 1.10);         // of conifers' leaves over those of other trees, ...
const float BELT = 900.0;                             // ... which they replace over this height below the tree line, m
const vec2 STEEP = vec2(0.75, 0.06);                  // upward normal below which crowns don't hide the ground; spread
const float CANOPY_CONTRAST = 0.75;                   // of crowns over the texture's: leaves scatter light into gaps
const float EDGE_SHADE = 0.45;                        // sunlight lost among the trunks and in the shadow of a forest's edge
const float BED_SPAN = 700.0;  // m of height after which beds repeat
const float FINER_BEDS = 3.7;  // fine beds per bed
const float BED_BEND = 14.0;   // m, amplitude of the folds of beds
const float LEDGE = 2.0;       // m, step of the finite difference of ledges
const float LEDGE_SLOPE = 0.5; // slope of a ledge's edge

// Hardness of the bed that a rock face cuts at a height (m), about -1 to 1: slightly bent bands.
//   footprint  of a pixel, m: explicit mipmap level, as the control flow is not uniform
float bed_hardness(float height, float bend, float footprint)
{
    float at = (height + eye.z + BED_BEND * bend) / BED_SPAN;
#if MATERIALS == 1
    return sin(40.0 * at) * 0.4 + 0.5 * sin(97.0 * at + 1.0);
#else
    float lod = log2(footprint * float(textureSize(noise_field, 0).y) / BED_SPAN);
    return textureLod(noise_field, vec2(0.37, at), lod).z
        + 0.6 * textureLod(noise_field, vec2(0.71, at * FINER_BEDS), lod + log2(FINER_BEDS)).z;
#endif
}

// The materials of greatest weight so far, by decreasing weight.
struct StrongestMaterials {
    vec3 weight;
    ivec3 layer;
};

void insert_material(float w, int layer, inout StrongestMaterials s)
{
    bool first = w > s.weight.x, second = w > s.weight.y, third = w > s.weight.z;
    s.weight.z = second ? s.weight.y : third ? w : s.weight.z;
    s.layer.z = second ? s.layer.y : third ? layer : s.layer.z;
    s.weight.y = first ? s.weight.x : second ? w : s.weight.y;
    s.layer.y = first ? s.layer.x : second ? layer : s.layer.y;
    s.weight.x = first ? w : s.weight.x;
    s.layer.x = first ? layer : s.layer.x;
}

// The strongest materials of a G-buffer sample, after noise has frayed borders that are smooth by interpolation.
StrongestMaterials select_materials(ivec2 at, Noise noise)
{
    vec4 fray = 2.0 * (noise.middle * 0.45 + noise.small * 0.4);
    StrongestMaterials selected = StrongestMaterials(vec3(-1.0), ivec3(0));
    for (int k = 0; k < WEIGHT_WORDS; ++k) {
        vec4 weights = texelFetch(gbuffer_weights[k], at, 0);
        vec4 frayed = weights + (k % 2 == 0 ? fray : -fray) * weights * (1.0 - weights);
        for (int i = 0; i < 4; ++i) insert_material(frayed[i], 4 * k + i, selected);
    }
    return selected;
}

// Horizontal beds of a rock face: bands of colour, and ledges.
void add_beds(inout MaterialSample rock, Noise noise, vec3 planes, float footprint)
{
    float bend = noise.wide.w + 0.5 * noise.middle.x;
    float bed = bed_hardness(position.z, bend, footprint);
    vec3 banded = mix(vec3(0.66, 0.65, 0.65), vec3(1.20, 1.17, 1.10), smoothstep(-0.8, 0.8, bed));
    rock.albedo *= mix(vec3(1.0), banded, 0.35 + 0.45 * trees.y);
#if MATERIALS > 1 && DETAIL
    // Hard beds protrude: their upper edges face the sky.
    rock.bump.z -= LEDGE_SLOPE * (1.0 - planes.z) * (bed_hardness(position.z + LEDGE, bend, footprint) - bed);
#endif
}

// Blend the selected materials by height.
MaterialSample compose(StrongestMaterials selected, Noise noise, vec3 n, float distance, float footprint)
{
    vec3 planes = triplanar_weights(n);
    float level = log(max(distance / FULL_SIZE, 1.0)) / log(RATIO);
    // Patch by patch, while trees get fewer.
    is_canopy = distance / trees.x + CANOPY_FROM.y * noise.small.x > CANOPY_FROM.x
        && n.z + STEEP.y * noise.small.y > STEEP.x;
    float belt = smoothstep(-BELT, -0.15 * BELT, position.z + eye.z - eye.w);
    int least = planes.x <= planes.y && planes.x <= planes.z ? 0 : planes.y <= planes.z ? 1 : 2;
    int a = least == 0 ? 1 : 0;
    int b = least == 2 ? 1 : 2;
    float share = planes[b] / max(planes[a] + planes[b], 1e-4);
    MaterialSample all = NO_MATERIAL;
#if MATERIALS == 1
    const int count = 1;
#else
    int count = selected.weight.y < LEAST_SHARE ? 1 : MATERIALS == 2 || selected.weight.z < LEAST_SHARE ? 2 : 3;
#endif
    for (int k = 0; k < count; ++k) {
        float weight = k == 0 ? selected.weight.x : k == 1 ? selected.weight.y : selected.weight.z;
        int layer = k == 0 ? selected.layer.x : k == 1 ? selected.layer.y : selected.layer.z;
        float crowns = is_canopy && DISTANT_LAYER(layer) != layer ? 1.0 : 0.0;
        layer = crowns > 0.0 ? DISTANT_LAYER(layer) : layer;
        MaterialSample material = sample_material(layer, position, n, a, b, share, level, footprint);
        vec3 leaves = CANOPY_TONE * mix(vec3(1.0), CONIFERS, belt) * mix(means[layer], material.albedo, CANOPY_CONTRAST);
        material.albedo = mix(material.albedo, leaves, crowns);
#if COVERED
        float own = dot(material.albedo, vec3(1.0)) / dot(means[layer], vec3(1.0));
#endif
        material.albedo *= variety(layer, noise.wide, noise.middle, noise.small);
        if (IS_BEDDED(layer)) add_beds(material, noise, planes, footprint);
        float height = weight + material.height;
        if (k == 0) {
            all = material;
            all.height = height;
            canopy = crowns;
#if COVERED
            grain = own;
#endif
        } else {
            float opacity = layer_share(all.height, material.height, weight);
            float below = all.height;
            all = mix_materials(all, material, opacity);
            all.height = mix(below, height, opacity);
            canopy = mix(canopy, crowns, opacity);
#if COVERED
            grain = mix(grain, own, opacity);
#endif
        }
    }
#if MATERIALS == 1
    // Only one material is sampled: near a border it takes on the mean colour of the other.
    ivec2 both = selected.layer.xy;
    if (is_canopy) both = ivec2(DISTANT_LAYER(both.x), DISTANT_LAYER(both.y));
    vec3 towards = means[both.y] * tints[both.y] / (means[both.x] * tints[both.x]);
    all.albedo *= mix(vec3(1.0), towards, 0.5 * smoothstep(-SOFT_BORDER, 0.0, selected.weight.y - selected.weight.x));
#endif
    return all;
}

#if APPEARANCE
// Where the middle of the pixel meets the plane of the sample that is shaded: edges of paint are of whole pixels.
vec3 middle_of_pixel(vec3 n)
{
#if SAMPLES == 1
    return position;
#else
    vec2 place = gl_FragCoord.xy * float(SAMPLES) / vec2(textureSize(gbuffer_depth, 0));
    vec4 ahead = from_clip * vec4(place * 2.0 - 1.0, 0.5, 1.0);
    vec3 ray = normalize(ahead.xyz / ahead.w);
    float sine = dot(ray, n);
    return sine < -LEAST_SINE ? ray * (dot(position, n) / sine) : position;
#endif
}
#endif

void main()
{
    float depth;
    ivec2 at = nearest_sample(gbuffer_depth, ivec2(gl_FragCoord.xy), depth);
    position = position_of(gbuffer_depth, at, depth);
    float distance = length(position);
    vec3 to_eye = -position / distance;
    vec3 n = normalize(texelFetch(gbuffer_normal, at, 0).xyz + vec3(0.0, 0.0, 1e-4));
    float footprint = distance * trees.z * pow(max(dot(n, to_eye), 0.05), -0.35);
    Noise noise = noise_at(position, footprint);
    MaterialSample material = compose(select_materials(at, noise), noise, n, distance, footprint);
#if APPEARANCE
    vec3 through;
    vec4 over = painted(middle_of_pixel(n), n, trees.z, through);
    material.albedo = material.albedo * through + over.rgb * (over.a * grain);
#endif
#if DRAPED
    vec4 above = texelFetch(draped, ivec2(gl_FragCoord.xy), 0);
    material.albedo = mix(material.albedo, above.rgb / max(above.a, 1e-4) * grain, above.a);
#endif
    vec2 light = ground_light(position.xy).rg;
#if MATERIALS > 1
    if (is_canopy) {
        vec4 w[WEIGHT_WORDS];
        for (int k = 0; k < WEIGHT_WORDS; ++k) w[k] = texelFetch(gbuffer_weights[k], at, 0);
        float wooded = WOODED(w);
        light.x *= 1.0 - EDGE_SHADE * smoothstep(0.02, 0.25, wooded) * (1.0 - smoothstep(0.45, 0.85, wooded));
    }
#endif
    vec3 lit = lit_material(material, position, n, to_eye, light);
#if MATERIALS > 1
    if (canopy > 0.0) lit = mix(lit, lit_canopy(material, position, n, to_eye, light), canopy);
#endif
    radiance = vec4(through_air(lit, position), depth);
}
