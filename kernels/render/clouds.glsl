// A layer of cumulus, the same for the sky and for the shadows that it throws.
// CLOUDS: 0 none, 1 flat, 2 with depth, as far as the sky shows it (clouds.frag.glsl). GREY: whether the sky has
// begun to be overcast.
#ifndef CLOUDS
#define CLOUDS 1
#define GREY 1
#endif
#ifndef MATERIALS
#define MATERIALS 2
#endif
uniform sampler2D noise_field;   // textures.py: tileable_noise
uniform sampler2D cloud_field;   // r: how far a place is inside a cloud, below 0 outside (render/clouds.py)
uniform vec2 cloud_drift;        // m that the wind has carried the layer
uniform float overcast;          // 0 none … 1 one grey layer hides all else
const float CLOUD_BASE = 1900.0; // m above the haze's base
const float CLOUD_PERIOD = 16384.0; // m, after which the field repeats
const float SHADE = 0.52;        // share of sunlight that the thickest clouds take from the ground
const float EARTH = 6360e3;      // m

vec2 cloud_place(vec2 place) { return (place + eye.xy - cloud_drift) / CLOUD_PERIOD; }

// Density of the layer above a place (m, relative to the eye), 0..1.
float cloud_density(vec2 place)
{
#if CLOUDS == 0
    return 0.0;
#else
    return smoothstep(0.0, 0.7, texture(cloud_field, cloud_place(place)).r);
#endif
}

// Share of sunlight that comes through the clouds to a place (m, relative to the eye).
float cloud_shadow(vec3 place)
{
#if CLOUDS == 0
    return 1.0;
#else
    float up = CLOUD_BASE + reach.y - eye.z - place.z;
    vec2 above = place.xy + to_sun.xy / max(to_sun.z, 0.05) * max(up, 0.0);
    return 1.0 - SHADE * smoothstep(-0.12, 0.8, textureLod(cloud_field, cloud_place(above), 0.0).r);
#endif
}

// How far away a direction meets a layer (m over the eye), on a round earth.
float to_layer(float up, float rise) { return 2.0 * up / (rise + sqrt(rise * rise + 2.0 * up / EARTH)); }
