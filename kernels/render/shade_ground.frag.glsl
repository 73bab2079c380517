#version 430 core
// The ground: height-blended materials (Zaaijer 2013, §5.4), lit by sun and sky, seen through the air.
//
// A driver that runs on the CPU takes both sides of every branch, so what costs is fixed (render/shading.py):
//   MATERIALS  1 to 3: the strongest materials of a pixel
//   PLANES, SIZES, HEXES, DETAIL  how each is textured, render/matter.glsl
//   SHADE_MAPS 0, 1 or 2: maps of the plants' shadows
//   SAMPLES    along each axis of a pixel
// With one material, one look-up of noise stands for three, for clouds' shadows too.
#include "render/frame.glsl"
#include "render/surface.glsl"
#include "render/triplanar.glsl"
#include "render/height_blend.glsl"
#include "render/matter.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#include "render/variety.glsl"

uniform sampler2D gbuffer_depth; // SAMPLES² samples a pixel, ground.frag.glsl
uniform sampler2D gbuffer_normal;
uniform sampler2D gbuffer_weights_low;
uniform sampler2D gbuffer_weights_high;

layout(location = 0) out vec4 radiance; // w: depth of the sample that was shaded

vec3 position; // of the point that is shaded, m from the eye

#if MATERIALS == 1
uniform vec3 means[9];         // mean albedo of the layers
const float SOFT_BORDER = 0.6; // of weight, by which one material leads where the other's colour is gone
#endif
const float BED_SPAN = 700.0;  // m of height after which beds repeat
const float FINER_BEDS = 3.7;  // of them to a bed
const float BED_BEND = 14.0;   // m up and down that they bend
const float LEDGE = 2.0;       // m, over which the slope of ledges is taken
const float LEDGE_SLOPE = 0.5; // of a ledge's edge over its face

// How hard the bed is that a rock face cuts through at a height of the place (m), about -1 to 1: bands, bent a little.
//   footprint  of a pixel, m: the mipmap is given, for neighbouring pixels may not come here
float bed_at(float height, float bend, float footprint)
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

// The strongest materials so far, strongest first.
struct Strongest {
    vec3 weight;
    ivec3 layer;
};

void consider(float w, int layer, inout Strongest s)
{
    bool first = w > s.weight.x, second = w > s.weight.y, third = w > s.weight.z;
    s.weight.z = second ? s.weight.y : third ? w : s.weight.z;
    s.layer.z = second ? s.layer.y : third ? layer : s.layer.z;
    s.weight.y = first ? s.weight.x : second ? w : s.weight.y;
    s.layer.y = first ? s.layer.x : second ? layer : s.layer.y;
    s.weight.x = first ? w : s.weight.x;
    s.layer.x = first ? layer : s.layer.x;
}

void main()
{
    // The nearest sample of the pixel stands for all of them.
    ivec2 pixel = ivec2(gl_FragCoord.xy) * SAMPLES;
    ivec2 chosen_sample = pixel;
    float depth = 1.0;
    for (int k = 0; k < SAMPLES * SAMPLES; ++k) {
        ivec2 at = pixel + ivec2(k % SAMPLES, k / SAMPLES);
        float d = texelFetch(gbuffer_depth, at, 0).r;
        chosen_sample = d < depth ? at : chosen_sample;
        depth = min(d, depth);
    }
    vec2 size = vec2(textureSize(gbuffer_depth, 0));
    vec4 unprojected = from_clip * vec4(vec3((vec2(chosen_sample) + 0.5) / size, min(depth, 0.9999999)) * 2.0 - 1.0, 1.0);
    position = unprojected.xyz / unprojected.w;
    vec4 weights_low = texelFetch(gbuffer_weights_low, chosen_sample, 0);
    vec4 weights_high = texelFetch(gbuffer_weights_high, chosen_sample, 0);

    float distance = length(position);
    vec3 to_eye = -position / distance;
    vec3 n = normalize(texelFetch(gbuffer_normal, chosen_sample, 0).xyz + vec3(0.0, 0.0, 1e-4));
    float footprint = distance * trees.z * pow(max(dot(n, to_eye), 0.05), -0.35);

#if MATERIALS == 1
    vec4 middle = textureLod(noise_field, (position.xy + eye.xy) / 512.0 + 0.37, floor(log2(footprint) + 0.5));
    vec4 wide = middle.zxwy, small = middle.yzxw;
#else
    vec4 wide = texture(noise_field, (position.xy + eye.xy) / 4096.0);
    vec4 middle = texture(noise_field, (position.xy + eye.xy) / 512.0 + 0.37);
    vec4 small = texture(noise_field, (position.xy + eye.xy) / 64.0 + 0.71);
#endif

    // Noise frays the borders that weights interpolated over a quad leave smooth.
    vec4 fray = 2.0 * (middle * 0.45 + small * 0.4);
    vec4 low = weights_low + fray * weights_low * (1.0 - weights_low);
    vec4 high = weights_high - fray * weights_high * (1.0 - weights_high);
    Strongest chosen = Strongest(vec3(-1.0), ivec3(0));
    consider(low.x, 0, chosen);
    consider(low.y, 1, chosen);
    consider(low.z, 2, chosen);
    consider(low.w, 3, chosen);
    consider(high.x, 4, chosen);
    consider(high.y, 5, chosen);
    consider(high.z, 6, chosen);
    consider(high.w, 7, chosen);

    vec3 planes = triplanar_weights(n);
    float level = log(max(distance / FULL_SIZE, 1.0)) / log(RATIO);
    float into_canopy = smoothstep(0.80, 1.0, distance / trees.x + 0.12 * small.x);
    int least = planes.x <= planes.y && planes.x <= planes.z ? 0 : planes.y <= planes.z ? 1 : 2;
    int a = least == 0 ? 1 : 0;
    int b = least == 2 ? 1 : 2;
    float share = planes[b] / max(planes[a] + planes[b], 1e-4);
    Matter all = NO_MATTER;
#if MATERIALS == 1
    const int count = 1;
#else
    int count = chosen.weight.y < LEAST_SHARE ? 1 : MATERIALS == 2 || chosen.weight.z < LEAST_SHARE ? 2 : 3;
#endif
    for (int k = 0; k < count; ++k) {
        float weight = k == 0 ? chosen.weight.x : k == 1 ? chosen.weight.y : chosen.weight.z;
        int layer = k == 0 ? chosen.layer.x : k == 1 ? chosen.layer.y : chosen.layer.z;
        layer = layer == FOREST_FLOOR && into_canopy > 0.5 ? CANOPY : layer;
        Matter matter = matter_at(layer, position, n, a, b, share, level, footprint);
        matter.albedo *= variety(layer, wide, middle, small);
        if (layer == ROCK) {
            float bend = wide.w + 0.5 * middle.x;
            float bed = bed_at(position.z, bend, footprint);
            vec3 banded = mix(vec3(0.66, 0.65, 0.65), vec3(1.20, 1.17, 1.10), smoothstep(-0.8, 0.8, bed));
            matter.albedo *= mix(vec3(1.0), banded, 0.35 + 0.45 * trees.y);
#if MATERIALS > 1 && DETAIL
            // Hard beds stand out: their upper edges face the sky, their lower ones the ground.
            matter.bump.z -= LEDGE_SLOPE * (1.0 - planes.z) * (bed_at(position.z + LEDGE, bend, footprint) - bed);
#endif
        }
        float height = weight + matter.height;
        if (k == 0) {
            all = matter;
            all.height = height;
        } else {
            float over = layer_share(all.height, matter.height, weight);
            float below = all.height;
            all = lerp(all, matter, over);
            all.height = mix(below, height, over);
        }
    }

#if MATERIALS == 1
    // Only one material is read. Where two meet each takes the other's mean colour in, so that no border cuts.
    ivec2 both = ivec2(chosen.layer.x == FOREST_FLOOR && into_canopy > 0.5 ? CANOPY : chosen.layer.x,
        chosen.layer.y == FOREST_FLOOR && into_canopy > 0.5 ? CANOPY : chosen.layer.y);
    vec3 towards = means[both.y] * tints[both.y] / (means[both.x] * tints[both.x]);
    all.albedo *= mix(vec3(1.0), towards, 0.5 * smoothstep(-SOFT_BORDER, 0.0, chosen.weight.y - chosen.weight.x));
#endif

    vec3 normal = normalize(n + all.bump);
    vec4 light = ground_light(position.xy);
    float sun = light.r * tree_shade(position, n) * cloud_shadow(position);
    float open = light.g * all.open;
    vec3 f0 = vec3(0.03);
    vec3 lit = reflectance(all.albedo, f0, all.roughness, normal, to_eye, to_sun.xyz) * sun_light.rgb * sun;
    lit += all.albedo / PI * sky_irradiance(normal) * open;
    radiance = vec4(through_air(lit, position), depth);
}
