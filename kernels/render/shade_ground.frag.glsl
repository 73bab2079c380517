#version 430 core
// Deferred shading of the terrain: height-blended materials (Zaaijer 2013, §5.4), lit by sun and sky, through the air.
//
// A CPU driver executes both sides of every branch, so the cost is fixed by macros (render/shading.py):
//   MATERIALS  1 to 3: number of blended materials; with one, a single noise lookup replaces three
//   PLANES, SIZES, HEXES, DETAIL  texturing of each material, render/matter.glsl
//   WEIGHT_WORDS, DISTANT_LAYER(layer)  of the sketch's materials, render/textures.py
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
const float MANY_PATCHES = 0.6;    // how much their shares, not their heights, determine the mean of many
const float PATCH_FRAY = 0.2;      // of that mean's patches, which are wider than a pixel
const float PATCH_EDGE = MATERIALS == 3 ? 0.2 : 0.5; // of shares, half the width of patches' edges
const vec2 PATCH = vec2(0.3, 2.0); // m, footprints of pixels with one patch of a material and with many

// Beds as kernels/strata.clh has them, and joints across them.
uniform vec4 strata;           // beds per m eastward, northward and upward; the eye's coordinate
uniform vec4 joints;           // joints per m eastward and northward; the eye's coordinate; how open they are, 0 ... 1
uniform float banding;         // how much the beds' colours differ, 0 ... 1
const float FINER_BEDS = 3.7;  // fine beds a bed
const float GROUPED = 0.7;     // hardness that a group's beds have in common
const float BED_BEND = 0.10;   // beds
const uint FINE_SALT = 0x68E31DA4u;
const float LEDGE = 0.02;      // beds, least step of the finite difference of ledges
const float LEDGE_SLOPE = 1.0; // slope of a ledge's edge
const float JOINT_WIDTH = 0.05, JOINT_DEPTH = 0.55; // of the space between two; share of the light that it takes
// Gullies and ribs of a face, V-shaped where a noise changes its sign, of a wide range of widths.
const float GULLY_SPAN = 1024.0;               // m of the noise across the fall line; wavelengths of its half and less
const float GULLY_STRETCH = 3.0;               // height over which it repeats, spans
const float GULLY_DEPTH = 16.0;                // m a unit of the noise
const float GULLY_LEAST = 4.0;                 // pixels, half the width of the finest
const float GULLY_CREASE = 0.8;                // of what is V-shaped over what is round
const float GULLY_BEND = 24.0;                 // m
const vec2 GULLY_STEEP = vec2(0.93, 0.76);     // upward normals between which they set in
const vec2 GULLY_FROM = vec2(0.2, 1.2);        // m, footprints of pixels: closer by, tiles and textures have the relief
const float GULLY_FRAY = 1.0;                  // how much rock keeps to ribs, other materials to gullies
const float STREAK_DEPTH = 0.5, GULLY_SHADE = 0.5; // shares of light that wet streaks and walls take
const float LICHEN_SPAN = 16.0; // m

#include "render/hash.glsl"

float hash_of(int n, uint salt) { return float(int(hash32(uint(n) + salt))) / 2147483648.0; }

float hardness_at(float c, uint salt)
{
    float bed = floor(c);
    return mix(hash_of(int(bed), salt), hash_of(int(bed) + 1, salt), smoothstep(0.3, 0.7, c - bed));
}

// Hardness of the bed at a coordinate across the strata, about -1 to 1.
//   footprint  of a pixel, beds
float bed_hardness(float c, float footprint)
{
#if MATERIALS == 1
    return 0.4 * sin(4.0 * c) + 0.5 * sin(9.7 * c + 1.0);
#else
    const vec3 finer = vec3(1.0, FINER_BEDS, FINER_BEDS * FINER_BEDS); // the last are layers of the beds
    vec3 share = clamp(2.0 - 2.0 * finer * footprint, 0.0, 1.0) * vec3(1.0, 0.6, 0.4);
    bool far = share.z == 0.0; // groups of beds take over from layers that are finer than a pixel
    float third = far ? 1.0 / FINER_BEDS : finer.z;
    share.z = far ? GROUPED * clamp(finer.z * footprint - 1.0, 0.0, 1.0) : share.z;
    return share.x * hardness_at(c, 0u) + share.y * hardness_at(finer.y * c, FINE_SALT)
        + share.z * hardness_at(third * c, FINE_SALT);
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

// Gullies down the fall line: between the two nearest of eight directions, along which the noise is stretched.
struct Gullies {
    vec3 bump;
    float rib; // -0.5 in gullies, about 0.5 on ribs; 0 where there are none
};

Gullies gullies_at(vec3 n, Noise noise, float footprint)
{
    Gullies g = Gullies(vec3(0.0), 0.0);
#if MATERIALS > 1 && DETAIL
    float steep = smoothstep(GULLY_STEEP.x, GULLY_STEEP.y, n.z) * smoothstep(GULLY_FROM.x, GULLY_FROM.y, footprint)
        * mix(0.2, 1.0, smoothstep(-0.6, 0.6, noise.wide.z + 0.5 * noise.middle.x)); // some faces are smooth slabs
    float direction = atan(n.y, n.x) * 4.0 / PI;
    float upper = smoothstep(0.3, 0.7, fract(direction));
    int first = upper > 1.0 - LEAST_SHARE ? 1 : 0, last = steep == 0.0 ? -1 : upper < LEAST_SHARE ? 0 : 1;
    float texel = GULLY_SPAN / float(textureSize(noise_field, 0).x);
    float pitch = max(GULLY_LEAST * footprint, texel), lod = log2(pitch / texel);
    for (int k = first; k <= last; ++k) {
        float weight = steep * (first == last ? 1.0 : k == 1 ? upper : 1.0 - upper);
        int turn = int(floor(direction)) + k & 3;
        vec2 strike = vec2(turn == 0 ? 0.0 : turn == 1 ? -1.0 : 1.0, turn == 2 ? 0.0 : 1.0); // the noise's period stays
        vec3 place = position + eye.xyz;
        vec2 at = vec2(dot(place.xy, strike) + GULLY_BEND * noise.middle.y, place.z / GULLY_STRETCH) / GULLY_SPAN;
        vec2 here = textureLod(noise_field, at, lod).xz;
        vec2 beside = textureLod(noise_field, at + vec2(pitch / GULLY_SPAN, 0.0), lod).xz;
        vec2 depth = vec2(here.y, beside.y) + GULLY_CREASE * abs(vec2(here.x, beside.x));
        g.bump.xy -= weight * GULLY_DEPTH * (depth.y - depth.x) / pitch * strike;
        g.rib += weight * clamp(depth.x - 0.3, -0.5, 0.5);
    }
#endif
    return g;
}

// The strongest materials of a G-buffer sample, after noise has frayed borders that are smooth by interpolation.
StrongestMaterials select_materials(ivec2 at, Noise noise, float rib)
{
    vec4 fray = 2.0 * (noise.middle * 0.45 + noise.small * 0.4);
    StrongestMaterials selected = StrongestMaterials(vec3(-1.0), ivec3(0));
    for (int k = 0; k < WEIGHT_WORDS; ++k) {
        vec4 weights = texelFetch(gbuffer_weights[k], at, 0);
        vec4 frayed = weights + (k % 2 == 0 ? fray : -fray) * weights * (1.0 - weights);
#if MATERIALS > 1 && DETAIL
        vec4 fringe = GULLY_FRAY * rib * weights * (1.0 - weights);
        for (int i = 0; i < 4; ++i) frayed[i] += IS_BEDDED(4 * k + i) ? fringe[i] : -fringe[i];
#endif
        for (int i = 0; i < 4; ++i) insert_material(frayed[i], 4 * k + i, selected);
    }
    return selected;
}

// Beds of a rock face: bands of colour and ledges, joints, streaks where water runs down, lichen on gentler faces.
void add_beds(inout MaterialSample rock, Noise noise, vec3 n, vec3 planes, float footprint, float rib)
{
    float bed_footprint = footprint * length(strata.xyz);
    float c = dot(position, strata.xyz) + strata.w + BED_BEND * (noise.wide.w + 0.5 * noise.middle.x);
    float bed = bed_hardness(c, bed_footprint);
    vec3 banded = mix(vec3(0.66, 0.65, 0.65), vec3(1.20, 1.17, 1.10), smoothstep(-0.8, 0.8, bed));
    rock.albedo *= mix(vec3(1.0), banded, banding);
#if MATERIALS > 1 && DETAIL
    // Hard beds protrude: their upper edges face the sky.
    float steep = 1.0 - planes.z;
    rock.bump.z -= LEDGE_SLOPE * steep * (bed_hardness(c + max(LEDGE, 0.5 * bed_footprint), bed_footprint) - bed);
    float joint = dot(position.xy, joints.xy) + joints.z + hash_of(int(floor(c)), 1u) + 0.15 * noise.small.x;
    float width = max(JOINT_WIDTH, footprint * length(joints.xy));
    float open = joints.w * smoothstep(-0.2, 0.6, hash_of(int(floor(joint)), 2u)) * JOINT_WIDTH / width;
    rock.albedo *= 1.0 - JOINT_DEPTH * open * steep * (1.0 - smoothstep(0.0, width, abs(fract(joint) - 0.5)));
    vec3 place = position + eye.xyz;
    float texel = footprint * float(textureSize(noise_field, 0).x);
    float streak = smoothstep(0.0, -0.5, rib + 0.2 * noise.middle.y);
    rock.albedo *= 1.0 - STREAK_DEPTH * streak * steep * smoothstep(0.6, -0.4, bed);
    rock.open *= 1.0 - GULLY_SHADE * streak;
    vec4 patchy = textureLod(noise_field, (place.xy + place.z) / LICHEN_SPAN, log2(texel / LICHEN_SPAN));
    vec2 lichen = smoothstep(vec2(0.0, 0.35), vec2(0.7, 0.8), patchy.xy + 0.5 * noise.middle.zw) * (1.0 - trees.y);
    rock.albedo = mix(rock.albedo, vec3(0.062, 0.064, 0.052), 0.5 * lichen.x);
    rock.albedo = mix(rock.albedo, vec3(0.125, 0.125, 0.055), 0.5 * lichen.y * smoothstep(0.2, 0.8, n.z));
#endif
}

// Blend the selected materials by height.
MaterialSample compose(StrongestMaterials selected, Noise noise, vec3 n, float distance, float footprint, float rib)
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
    float total = selected.weight.x, many = MANY_PATCHES * smoothstep(PATCH.x, PATCH.y, footprint);
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
        // A loop, which CPU drivers skip where no pixel has beds.
        for (int beds = IS_BEDDED(layer) ? 1 : 0; beds > 0; --beds) add_beds(material, noise, n, planes, footprint, rib);
        float height = weight + material.height;
        if (k == 0) {
            all = material;
            all.height = height;
            canopy = crowns;
#if COVERED
            grain = own;
#endif
        } else {
            total += weight;
            // Of opposite signs in both orders of two materials, or patches would end abruptly where the order changes.
            float fray = layer < selected.layer.x ? PATCH_FRAY : -PATCH_FRAY;
            float edge = IS_BEDDED(layer) != IS_BEDDED(selected.layer.x) ? 0.5 : PATCH_EDGE; // turf thins out on rock
            float patches = weight / total + fray * (noise.middle.z - noise.small.z);
            float opacity = mix(layer_share(all.height, material.height, weight), smoothstep(0.5 - edge, 0.5 + edge, patches), many);
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
    Gullies gullies = gullies_at(n, noise, footprint);
    StrongestMaterials selected = select_materials(at, noise, gullies.rib);
    MaterialSample material = compose(selected, noise, n, distance, footprint, gullies.rib);
    material.bump += gullies.bump;
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
#if APPEARANCE && APPEARANCE_FILTER
    // A loop, which CPU drivers skip where no pixel is unlit. Colours of styles are relative to paper, WHITE.
    for (int some = appearance_unlit > 0.0 ? 1 : 0; some > 0; --some) {
        vec3 shown = clamp(over.rgb / 0.8, 0.0, 1.0);
        shown = mix(12.92 * shown, 1.055 * pow(shown, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, shown));
        radiance.rgb = mix(radiance.rgb, light_of(shown) / appearance_exposure, appearance_unlit);
    }
#endif
}
