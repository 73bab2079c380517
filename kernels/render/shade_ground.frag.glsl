#version 430 core
// The ground: height-blended materials (Zaaijer 2013, §5.4), lit by sun and sky, seen through the air.
//
// A driver that runs on the CPU takes both sides of every branch, so what costs is fixed (render/shading.py):
//   MATERIALS  1 or 2: the strongest materials of a pixel
//   PLANES     1 or 2: each from the planes that its normal is nearest to (no more than two of the three triplanar
//              weights are ever much above zero)
//   SIZES      1 or 2: each at the sizes that suit its distance
//   SHADE_MAPS 0, 1 or 2: maps of the plants' shadows
//   SAMPLES    along each axis of a pixel
// With one material, one look-up of noise stands for three, for clouds' shadows too.
#include "render/frame.glsl"
#include "render/surface.glsl"
#include "render/triplanar.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"

#define FOREST_FLOOR 7
#define CANOPY 8

uniform sampler2DArray material_colour;
uniform sampler2DArray material_relief;
uniform vec2 phases[3 * OCTAVES]; // where the eye lies in the texture, by plane (yz, xz, xy) and octave
uniform vec2 octaves[9];          // finest and coarsest octave that suits a layer
uniform vec3 tints[9];            // climate's colour of a layer

uniform sampler2D seen_depth; // SAMPLES² samples a pixel, ground.frag.glsl
uniform sampler2D seen_normal;
uniform sampler2D seen_low;
uniform sampler2D seen_high;

layout(location = 0) out vec4 radiance; // w: depth of the sample that was shaded

vec3 position; // of the point that is shaded, m from the eye

const float FINEST = 6.0;   // m, width of a texture at octave 0
const float RATIO = 3.7;    // of one octave's width to the next
const float TURN = 0.65;    // rad, of one octave against the next: hides the repetition
const float FULL_SIZE = 22.0; // m, distance at which octave 0 is at its best

struct Matter {
    vec3 albedo;
    float height;
    vec2 slope; // in the plane it is textured from
    float roughness;
    float open;
};

Matter lerp(Matter a, Matter b, float t)
{
    return Matter(mix(a.albedo, b.albedo, t), mix(a.height, b.height, t), mix(a.slope, b.slope, t),
        mix(a.roughness, b.roughness, t), mix(a.open, b.open, t));
}

struct Plane {
    int axis;
    vec2 place; // m
};

Plane plane_of(int axis)
{
    return Plane(axis, axis == 0 ? position.yz : axis == 1 ? position.xz : position.xy);
}

//   footprint: width of a pixel on the ground, m
Matter at_octave(int layer, Plane p, int octave, float footprint)
{
    float scale = 1.0 / (FINEST * pow(RATIO, float(octave)));
    float c = cos(TURN * float(octave)), s = sin(TURN * float(octave));
    mat2 turn = mat2(c, s, -s, c);
    vec3 at = vec3(turn * p.place * scale + phases[p.axis * OCTAVES + octave], float(layer));
    float lod = log2(footprint * scale * float(textureSize(material_colour, 0).x));
    vec4 colour = textureLod(material_colour, at, lod);
    vec4 relief = textureLod(material_relief, at, lod);
    vec2 n = (relief.xy - 0.5) * 2.0;
    vec2 slope = transpose(turn) * (-n / sqrt(max(1.0 - dot(n, n), 0.1)));
    return Matter(colour.rgb * colour.rgb, colour.a, slope * pow(0.93, float(octave)), relief.b, relief.a);
}

// A layer at the octaves that suit the distance: structure of about one size on the screen, near and far.
Matter from_plane(int layer, Plane p, float level, float footprint)
{
    level = clamp(level, octaves[layer].x, octaves[layer].y);
#if SIZES == 1
    return at_octave(layer, p, int(level + 0.5), footprint);
#else
    int octave = min(int(level), OCTAVES - 2);
    return lerp(at_octave(layer, p, octave, footprint), at_octave(layer, p, octave + 1, footprint),
        smoothstep(0.2, 0.8, level - float(octave)));
#endif
}

vec3 turned(vec3 n, vec2 slope, int axis)
{
    if (axis == 0) return vec3(0.0, -slope) * sign(n.x);
    if (axis == 1) return vec3(-slope.x, 0.0, -slope.y) * sign(n.y);
    return vec3(-slope, 0.0);
}

// Colour of the beds that a rock face cuts through: bands by height, bent a little.
vec3 beds(float bend)
{
    float at = (position.z + eye.z + 14.0 * bend) / 700.0;
#if MATERIALS == 1
    float band = sin(40.0 * at) * 0.4 + 0.5 * sin(97.0 * at + 1.0);
#else
    float band = texture(noise_field, vec2(0.37, at)).z + 0.6 * texture(noise_field, vec2(0.71, at * 3.7)).z;
#endif
    return mix(vec3(0.70, 0.66, 0.64), vec3(1.22, 1.16, 1.06), smoothstep(-0.8, 0.8, band));
}

// The two strongest materials so far, strongest first.
struct Strongest {
    vec2 weight;
    ivec2 layer;
};

void consider(float w, int layer, inout Strongest s)
{
    bool first = w > s.weight.x, second = w > s.weight.y;
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
        float d = texelFetch(seen_depth, at, 0).r;
        chosen_sample = d < depth ? at : chosen_sample;
        depth = min(d, depth);
    }
    vec2 size = vec2(textureSize(seen_depth, 0));
    vec4 unprojected = from_clip * vec4(vec3((vec2(chosen_sample) + 0.5) / size, min(depth, 0.9999999)) * 2.0 - 1.0, 1.0);
    position = unprojected.xyz / unprojected.w;
    vec4 weights_low = texelFetch(seen_low, chosen_sample, 0);
    vec4 weights_high = texelFetch(seen_high, chosen_sample, 0);

    float distance = length(position);
    vec3 to_eye = -position / distance;
    vec3 n = normalize(texelFetch(seen_normal, chosen_sample, 0).xyz + vec3(0.0, 0.0, 1e-4));
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
    Strongest chosen = Strongest(vec2(-1.0), ivec2(0));
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
    Matter all;
    vec3 bump = vec3(0.0);
    for (int k = 0; k < MATERIALS; ++k) {
        int layer = chosen.layer[k] == FOREST_FLOOR && into_canopy > 0.5 ? CANOPY : chosen.layer[k];
#if PLANES == 1
        int axis = share > 0.5 ? b : a;
        Matter matter = from_plane(layer, plane_of(axis), level, footprint);
        vec3 matter_bump = turned(n, matter.slope, axis);
#else
        Matter on_a = from_plane(layer, plane_of(a), level, footprint);
        Matter on_b = from_plane(layer, plane_of(b), level, footprint);
        Matter matter = lerp(on_a, on_b, share);
        vec3 matter_bump = mix(turned(n, on_a.slope, a), turned(n, on_b.slope, b), share);
#endif
        matter.albedo *= tints[layer];
        if (layer == 0 || layer == 7) {
            float dry = smoothstep(-0.7, 0.8, wide.x + 0.55 * middle.y + 0.25 * small.z);
            matter.albedo *= mix(vec3(0.62, 0.82, 0.70), vec3(1.38, 1.16, 0.98), dry);
        }
        if (layer == CANOPY) matter.albedo *= mix(vec3(0.75, 0.85, 0.85), vec3(1.25, 1.12, 0.9), smoothstep(-0.6, 0.6, middle.x));
        if (layer == 2) matter.albedo *= mix(vec3(1.0), beds(wide.w + 0.5 * middle.x), 0.35 + 0.45 * trees.y);
        if (layer == 2 || layer == 3) matter.albedo *= mix(vec3(0.86, 0.90, 0.96), vec3(1.10, 1.02, 0.92), smoothstep(-0.7, 0.7, wide.y + 0.5 * middle.z));
        matter.albedo *= 1.0 + 0.16 * middle.w + 0.10 * small.w;
        float height = chosen.weight[k] + matter.height;
        if (k == 0) {
            all = matter;
            all.height = height;
            bump = matter_bump;
        } else {
            float share_ = smoothstep(all.height - 0.4, all.height + 0.4, height);
            all = lerp(all, matter, share_);
            all.height = mix(all.height, height, share_);
            bump = mix(bump, matter_bump, share_);
        }
    }

    vec3 normal = normalize(n + bump);
    vec4 light = ground_light(position.xy);
    float sun = light.r * tree_shade(position, n) * cloud_shadow(position);
    float open = light.g * all.open;
    vec3 f0 = vec3(0.03);
    vec3 lit = reflectance(all.albedo, f0, all.roughness, normal, to_eye, to_sun.xyz) * sun_light.rgb * sun;
    lit += all.albedo / PI * sky_irradiance(normal) * open;
    radiance = vec4(through_air(lit, position), depth);
}
