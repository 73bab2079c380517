// What is built on the ground: a texture of the ground's materials, with a colour of its own or as it lies there.
//   FAR  1: only the mean of the texture
#include "render/frame.glsl"
#include "render/surface.glsl"
#include "render/triplanar.glsl"
#include "render/matter.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#include "render/variety.glsl"
#include "render/lit_material.glsl"

uniform vec3 means[LAYERS]; // mean albedo of the layers

const vec3 LINE_ALBEDO = vec3(0.55, 0.55, 0.53);
const float SUNLIT_ABOVE = 40.0; // m over shaded ground at which its shadow is 1/e

// Share of an interval of half width `half_width` about 0 in one of width `seen` about x.
float covered(float x, float half_width, float seen)
{
    return clamp(min(half_width, x + 0.5 * seen) - max(-half_width, x - 0.5 * seen), 0.0, seen) / seen;
}

// Noise of about 1000, 100 and 10 m, with explicit mipmap levels, as the control flow is not uniform.
Noise built_noise(vec3 position, float footprint)
{
    vec2 place = position.xy + eye.xy;
    float lod = log2(footprint * float(textureSize(noise_field, 0).x));
    return Noise(textureLod(noise_field, place / 4096.0, lod - 12.0),
        textureLod(noise_field, place / 512.0 + 0.37, lod - 9.0), textureLod(noise_field, place / 64.0 + 0.71, lod - 6.0));
}

// Rails and sleepers of railway tracks.
//   at       m along the tracks, and across from the edge of the first one
//   spacing  m between the middles of two tracks
//   seen     width of a pixel, m: along, across
void lay_tracks(inout MaterialSample m, vec2 at, float spacing, vec2 seen)
{
    float across = abs(mod(at.y, spacing) - 0.5 * spacing);
    float sleeper = covered(mod(at.x, 0.6) - 0.3, 0.13, max(seen.x, 0.02)) * covered(across, 1.3, max(seen.y, 0.02));
    float rail = covered(across - 0.7535, 0.036, max(seen.y, 0.01));
    m.albedo = mix(m.albedo, vec3(0.36, 0.34, 0.31), mix(sleeper, 0.26, smoothstep(0.2, 0.6, seen.x)) * 0.85);
    m.albedo = mix(m.albedo, vec3(0.085, 0.070, 0.062), rail);
    m.roughness = mix(m.roughness, 0.45, rail);
}

// Marks of a carriageway, as kernels/appearance.clh paints them on the ground, of its constants.
//   at     m along the road, and across from the edge of the carriageway
//   width  of the carriageway, m
void lay_marks(inout MaterialSample m, vec2 at, float width, vec2 seen)
{
    seen = max(seen, vec2(0.02, 0.01));
    float lanes = max(floor(width / LANE + 0.5), 1.0), lane = width / lanes;
    float line = covered(abs(at.y - 0.5 * width) - (0.5 * width - LINE_INSET), LINE_HALF, seen.y);
    float nearest = clamp(floor(at.y / lane + 0.5), 1.0, max(lanes - 1.0, 1.0));
    float aside = at.y - nearest * lane;
    float dash = covered(mod(at.x, DASH) - 0.5 * DASH_DUTY * DASH, 0.5 * DASH_DUTY * DASH, seen.x);
    dash = mix(dash, DASH_DUTY, smoothstep(0.5, 1.0, seen.x / DASH));
    bool is_centre = lanes > 3.5 && 2.0 * nearest == lanes;
    float between = is_centre ? covered(abs(aside) - 2.0 * LINE_HALF, LINE_HALF, seen.y)
                              : covered(aside, LINE_HALF, seen.y) * dash;
    if (lanes > 1.5) line = max(line, between);
    m.albedo = mix(m.albedo, LINE_ALBEDO, 0.9 * line);
}

// Rows of tiles on a roof.
//   at  m along the eaves, and up
void lay_tiles(inout MaterialSample m, vec2 at, float seen)
{
    float clear = 1.0 - smoothstep(0.08, 0.25, seen);
    vec2 tile = vec2(at.x / 0.24 + 0.5 * mod(floor(at.y / 0.32), 2.0), at.y / 0.32);
    vec2 within = fract(tile) - vec2(0.5, 0.0);
    float shade = smoothstep(0.0, 0.25, within.y) * (1.0 - 0.35 * smoothstep(0.3, 0.5, abs(within.x)));
    float own = fract(sin(dot(floor(tile), vec2(12.99, 78.23))) * 43758.55);
    m.albedo *= mix(1.0, (0.55 + 0.5 * shade) * (0.85 + 0.3 * own), clear);
    m.bump += clear * 0.25 * vec3(0.0, 0.0, -within.y);
}

// Radiance of a built surface at a position (m from the eye).
//   colour  rgb: √ of its mean albedo; w: 1 if the surface has one, 0 for the ground's own
//   tone    factor of its light
//   look    x: layer; y: m between railway tracks, −1: tiles, less: −1 − width of a carriageway with marks
//   uv      m along and across; seen: width of a pixel in them
vec3 built_radiance(vec3 position, vec3 n, vec4 colour, float tone, vec2 look, vec2 uv, vec2 seen)
{
    float distance = length(position);
    vec3 to_eye = -position / distance;
    float footprint = distance * trees.z * pow(max(dot(n, to_eye), 0.05), -0.35);
    int layer = int(look.x + 0.5);
#if FAR
    vec4 mean = textureLod(material_colour, vec3(0.5, 0.5, float(layer)), COARSEST_LOD);
    vec4 relief = textureLod(material_relief, vec3(0.5, 0.5, float(layer)), COARSEST_LOD);
    MaterialSample m = MaterialSample(mean.rgb * mean.rgb, mean.a, vec3(0.0), relief.b, relief.a);
#else
    vec3 planes = triplanar_weights(n);
    float level = log(max(distance / FULL_SIZE, 1.0)) / log(RATIO);
    int least = planes.x <= planes.y && planes.x <= planes.z ? 0 : planes.y <= planes.z ? 1 : 2;
    int a = least == 0 ? 1 : 0;
    int b = least == 2 ? 1 : 2;
    float share = planes[b] / max(planes[a] + planes[b], 1e-4);
    MaterialSample m = sample_material(layer, position, n, a, b, share, level, footprint);
#endif
    Noise noise = built_noise(position, footprint);
    vec3 own = colour.rgb * colour.rgb / means[layer] * (1.0 + 0.10 * noise.small.w + 0.06 * noise.middle.w);
    m.albedo *= mix(variety(layer, noise.wide, noise.middle, noise.small), own, colour.w);
    if (look.y > 0.0) lay_tracks(m, uv, look.y, seen);
    if (look.y < -1.5) lay_marks(m, uv, -1.0 - look.y, seen);
    else if (look.y < 0.0) lay_tiles(m, uv, max(seen.x, seen.y));
    vec4 light = ground_light(position.xy);
    float shaded = exp(-max(eye.z + position.z - light.b, 0.0) / SUNLIT_ABOVE);
    return through_air(tone * lit_material(m, position, n, to_eye, 1.0 - (1.0 - light.rg) * shaded), position);
}
