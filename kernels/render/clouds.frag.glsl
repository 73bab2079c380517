#version 430 core
// Ray-marched cumulus: premultiplied radiance with aerial perspective, and transmittance. A cloud's height follows the
// coverage field; 3D noise erodes it (A. Schneider 2015). Rays are dithered in a 2x2 pattern that upscaling averages.
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

const float THICK = 950.0;      // m, of the layer
const float EXTINCTION = 0.03;  // 1/m, inside
const float BILLOW_PERIOD = 2300.0;     // m, period of the billow noise
const float FAR = 60e3;         // m
const float TALLEST = 2.3;      // field value of a cloud that fills the layer
const float FINEST = 20.0;      // smallest step, m
const float FINE = 0.0045;      // smallest step over the distance
const float CLEAR_RUN = 230.0;  // m of clear air per unit of the field below a cloud's edge

float billows(vec3 place)
{
    vec3 at = vec3(place.xy + cloud_origin.xy + eye.xy - cloud_drift, place.z + cloud_origin.z + eye.z) / BILLOW_PERIOD;
    return 0.65 * textureLod(billow_noise, at, 0.0).r + 0.35 * textureLod(billow_noise, at * 3.7 + 0.31, 0.0).r;
}

// 0..1, at a place relative to the eye; `rise` in the layer.
float body(vec3 place, float rise, float lod)
{
    float inside = textureLod(cloud_field, cloud_place(place.xy + cloud_origin.xy), lod).r;
    return inside - TALLEST * rise * (0.3 + 0.7 * rise) - 0.1 * (1.0 - smoothstep(0.0, 0.05, rise));
}

float eroded(float solid, vec3 place, float rise)
{
    float wear = mix(0.5, 1.15, sqrt(rise)) * (1.0 - billows(place));
    return clamp((solid - wear) * 2.2, 0.0, 1.0);
}

float depth_to_sun(vec3 place, float up, float lod)
{
    float depth = 0.0, gone = 0.0, step_ = 40.0;
    for (int i = 0; i < SUN_STEPS; ++i) {
        vec3 at = place + to_sun.xyz * (gone + 0.5 * step_);
        float rise = (at.z - up) / THICK;
        float high = clamp(rise, 0.0, 1.0);
        float solid = body(at, high, lod + 0.5 * float(i));
        // Nearby lumps are resolved; further on their mean is used.
        float density = i < 2 ? eroded(solid, at, high) : clamp((solid - 0.45 * mix(0.5, 1.15, sqrt(high))) * 2.2, 0.0, 1.0);
        depth += rise < 1.0 ? density * step_ : 0.0;
        gone += step_;
        step_ *= 2.1;
    }
    return depth * EXTINCTION;
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
    int steps = direction.z > -0.003 && first < FAR && !hidden() ? STEPS : 0;

    vec2 pixel = gl_FragCoord.xy;
    float shift = fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715)))); // Jimenez 2014
    float cosine = dot(direction, to_sun.xyz);
    float texel = CLOUD_PERIOD / float(textureSize(cloud_field, 0).x);
    float lod = max(log2(first * trees.z * 4.0 / texel), 0.0);
    vec3 light = vec3(0.0);
    float clear = 1.0, mean = 0.0, met = 1e-6;
    float gone = first + shift * max(FINEST, FINE * first);
    for (int i = 0; i < steps; ++i) {
        if (gone > last || clear < 0.02) break;
        float fine = max(FINEST, FINE * gone);
        vec3 place = direction * gone;
        place.z += gone * gone / (2.0 * EARTH);
        float at = clamp((place.z - up) / THICK, 0.0, 1.0);
        float solid = body(place, at, lod);
        float step_ = max(fine, -CLEAR_RUN * solid);
        if (solid > 0.0) {
            float density = eroded(solid, place, at);
            if (density > 0.0) {
                float passed = exp(-density * EXTINCTION * step_);
                float depth = depth_to_sun(place, up, lod);
                float edge = 1.0 - 0.5 * exp(-5.0 * density); // less multiple scattering in thin edges
                vec3 lit = (sunlit(depth, cosine) * SUN_GAIN + cloud_ambient(at)) * edge;
                light += clear * (1.0 - passed) * lit;
                mean += clear * (1.0 - passed) * gone;
                met += clear * (1.0 - passed);
                clear *= passed;
            }
        }
        gone += step_;
    }
    vec3 place = direction * (mean / met);
    float cover = (1.0 - clear) * (1.0 - overcast);
    vec3 behind = clear_air(place);
    vec3 air = direction.z > 0.0 ? clear_sky(direction) : air_light(direction);
    // Aerial perspective: in haze a cloud fades into the sky.
    seen = vec4(cover * mix(air, light / max(1.0 - clear, 1e-4), behind), 1.0 - cover);
}
