#version 430 core
// Ray-marched cumulus: premultiplied radiance with aerial perspective, and transmittance. A dome over each cloud of the
// field is displaced by 3D billows (A. Schneider 2015).
//   STEPS      maximum along a ray
//   SUN_STEPS  from each towards the sun
#include "render/frame.glsl"
#include "render/clouds.glsl"
#include "render/cloud_light.glsl"

uniform sampler3D billow_noise; // 0..1, billows (render/clouds.py)
#if CLOUDS == 2
uniform sampler2D scene_depth_buffer; // depth buffer
uniform int reduced_width;            // px, of this picture
const vec3 cloud_origin = vec3(0.0);
#endif

in vec2 uv;
out vec4 seen; // rgb: premultiplied radiance; a: transmittance

const float THICK = 1350.0;     // m, of the layer
const float EXTINCTION = 0.05;  // 1/m, inside
const float BILLOW_PERIOD = 65536.0 / 28.0; // m, period of the coarse billow noise: the eye's period is a multiple
const float FINER = 3.75;       // frequency of the fine one over the coarse one, likewise
const vec2 FINE_SEEN = vec2(9e3, 18e3); // m, distances over which fine billows become smaller than pixels and fade
const float FADES = 35e3;       // m, from where on clouds fade into haze ...
const float FAR = 60e3;         // ... until they are gone
const float FINEST = 26.0;      // smallest step, m
const float FINE = 0.0065;      // smallest step over the distance
const float FINE_SHARE = 0.35;  // amplitude of fine billows over all
const float SMALL = 0.2;        // km, radius of a small cloud
const float LUMPS = 0.62;       // height of the billows over a cloud's radius ...
const float LUMP = 210.0;       // ... up to so many m
const float SOFT = 55.0;        // m over which a cloud's edge becomes dense
const float BASE_RAGGED = 60.0; // m, unevenness of the condensation level
const float SKY_DEPTH = 350.0;  // m below a cloud's top within which the light of the sky falls to 1/e
const float CREVICE = 0.35;     // light of the sky that lumps keep from the seams between them
const float LIPSCHITZ = 1.0;    // step over the distance found to a smooth cloud ...
const float LIPSCHITZ_LUMPS = 0.8; // ... and to its billows

// Distance, m, from a place (m, relative to the eye) `rise` m over the base to the smooth surface of the next cloud,
// positive inside: of a sphere of radius R around a place at the base, R^2 - |p|^2 over R + |p|.
float smooth_depth(vec3 place, float rise, float lod, out float field)
{
    field = textureLod(cloud_field, cloud_place(place.xy + cloud_origin.xy), lod).r;
    float square = max(field, 0.0), high = 1e-3 * rise;
    float size = sqrt(square + high * high + SMALL * SMALL);
    return 1e3 * (min(field, 0.0) + (square - high * high) / (2.0 * size));
}

// Height, m, that billows add to or take from a cloud at most.
float lump(float field, float rise)
{
    return min(1e3 * LUMPS * sqrt(max(field, 0.0) + 0.01), LUMP) * mix(0.6, 1.0, smoothstep(0.0, 250.0, rise));
}

// Distance, m, to the surface of a cloud with billows, positive inside; `bump` -1 ... 1: between lumps, on one.
float lumpy(float inside, float reach, vec3 place, float rise, float far, out float bump)
{
    vec3 at = vec3(place.xy + cloud_origin.xy + eye.xy - cloud_drift, place.z + cloud_origin.z + eye.z) / BILLOW_PERIOD;
    bump = (1.0 - FINE_SHARE) * (2.0 * textureLod(billow_noise, at, 0.0).r - 1.0);
    float share = FINE_SHARE * (1.0 - smoothstep(FINE_SEEN.x, FINE_SEEN.y, far));
    float edge = inside + bump * reach;
    // Where fine billows decide.
    if (share > 0.0 && abs(edge) < SOFT + share * reach) bump += share * (2.0 * textureLod(billow_noise, at * FINER + 0.31, 0.0).r - 1.0);
    return min(inside + bump * reach, rise + BASE_RAGGED * bump);
}

float depth_to_sun(vec3 place, float up, float lod, float far)
{
    float depth = 0.0, gone = 0.0, step_ = 45.0, field, bump;
    for (int i = 0; i < SUN_STEPS; ++i) {
        vec3 at = place + to_sun.xyz * (gone + 0.5 * step_);
        float rise = max(at.z - up, 0.0);
        float inside = smooth_depth(at, rise, lod + 0.5 * float(i), field), reach = lump(field, rise);
        // Nearby lumps are resolved; further on their mean is used.
        if (i < 1 && abs(inside) < reach + SOFT) inside = lumpy(inside, reach, at, rise, far, bump);
        depth += clamp(inside / SOFT, 0.0, 1.0) * step_;
        gone += step_;
        step_ *= 2.7;
    }
    return depth * EXTINCTION;
}

// Share of a step by which a pixel's ray starts later: in 2x2 pixels, whose mean is seen (clouds.glsl).
float step_share(vec2 pixel)
{
    ivec2 odd = ivec2(pixel) & 1;
    return 0.125 + 0.5 * float(odd.x ^ odd.y) + 0.25 * float(odd.y);
}

#if CLOUDS == 2
bool hidden()
{
    ivec2 size = textureSize(scene_depth_buffer, 0);
    ivec2 at = ivec2(uv * vec2(size));
    int far = 2 * size.x / reduced_width;
    float nearest = 0.0;
    for (int i = 0; i < 4; ++i) {
        ivec2 step_ = far * ivec2((i & 1) * 2 - 1, (i & 2) - 1);
        nearest = max(nearest, texelFetch(scene_depth_buffer, clamp(at + step_, ivec2(0), size - 1), 0).r);
    }
    return nearest < 1.0;
}

vec3 direction_at(vec2 place)
{
    vec4 far_point = from_clip * vec4(place * 2.0 - 1.0, 1.0, 1.0);
    return normalize(far_point.xyz / far_point.w);
}
#else
bool hidden() { return false; }

// As `dome_clouds` reads it.
vec3 direction_at(vec2 place)
{
    vec2 flat_ = place * 2.0 - 1.0;
    float square = dot(flat_, flat_);
    return vec3(2.0 * flat_, 1.0 - square) / (1.0 + square);
}
#endif

void main()
{
    vec3 direction = direction_at(uv);
    float up = max(CLOUD_BASE + view_range.y - eye.z - cloud_origin.z, 300.0);
    float rise = max(direction.z, 0.0);
    float first = to_layer(up, rise);
    float last = to_layer(up + THICK, rise);
    int steps = direction.z > LOWEST && first < FAR && !hidden() ? STEPS : 0;

    float shift = step_share(gl_FragCoord.xy);
    float cosine = dot(direction, to_sun.xyz);
    float texel = CLOUD_PERIOD / float(textureSize(cloud_field, 0).x);
    float lod = max(log2(first * trees.z * 4.0 / texel), 0.0);
    vec3 phases = cloud_phases(cosine), below = cloud_ambient(0.0), above = cloud_ambient(1.0);
    vec3 light = vec3(0.0);
    float clear = 1.0, mean = 0.0, met = 1e-6;
    float gone = first + shift * max(FINEST, FINE * first);
    for (int i = 0; i < steps; ++i) {
        if (gone > last || clear < 0.05) break;
        vec3 place = direction * gone;
        place.z += gone * gone / (2.0 * EARTH);
        float rise = place.z - up, field;
        float inside = smooth_depth(place, rise, lod, field);
        float reach = lump(field, rise), fine = max(FINEST, FINE * gone), step_ = max(fine, -LIPSCHITZ * (inside + reach));
        float bump, surface = inside + reach > 0.0 ? lumpy(inside, reach, place, rise, gone, bump) : 0.0;
        if (surface < 0.0) step_ = max(fine, -LIPSCHITZ_LUMPS * surface);
        if (surface > 0.0) {
            float density = min(surface / SOFT, 1.0);
            float passed = exp(-density * EXTINCTION * step_);
            float depth = depth_to_sun(place, up, lod, gone);
            float top = 1e3 * sqrt(max(field, 0.0));
            float edge = 1.0 - 0.5 * exp(-5.0 * density); // less multiple scattering in thin edges
            vec3 diffuse = mix(below, above, exp(min(rise - top, 0.0) / SKY_DEPTH)) * (1.0 + CREVICE * bump);
            vec3 lit = (sunlit(depth, phases) * SUN_GAIN + diffuse) * edge;
            light += clear * (1.0 - passed) * lit;
            mean += clear * (1.0 - passed) * gone;
            met += clear * (1.0 - passed);
            clear *= passed;
        }
        gone += step_;
    }
    vec3 place = direction * (mean / met);
    float cover = (1.0 - clear) * (1.0 - smoothstep(FADES, FAR, first)) * (1.0 - overcast * overcast * overcast);
    vec3 behind = clear_air(place);
    vec3 air = direction.z > 0.0 ? clear_sky(direction) : air_light(direction);
    // Aerial perspective: in haze a cloud fades into the sky.
    seen = vec4(cover * mix(air, light / max(1.0 - clear, 1e-4), behind), 1.0 - cover);
}
