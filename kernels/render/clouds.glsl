// A layer of cumulus or stratocumulus, for the sky and for its shadows. CLOUDS: 0 none; 1 in a dome of all directions, 2 in the picture
// (clouds.frag.glsl). GREY: whether an overcast layer blends in. CIRRUS: whether there are ice clouds.
#ifndef CLOUDS
#define CLOUDS 1
#define GREY 1
#define CIRRUS 1
#endif
#ifndef MATERIALS
#define MATERIALS 2
#endif
uniform sampler2D noise_field;   // textures.py: tileable_noise
uniform sampler2D cloud_field;   // r: square of a cloud's height, km^2; outside: minus the distance to one, km (render/clouds.py)
uniform vec2 cloud_drift;        // displacement by wind, m
uniform float overcast;          // weight of the overcast layer, 0 … 1
const float CLOUD_BASE = 1900.0; // m above the haze's base
const float CLOUD_PERIOD = 32768.0; // m, period of the field
const float DENSE = 0.05;        // field value of a cloud that is opaque seen from below, km^2
const float SHADE = 0.65;        // sunlight absorbed by the thickest clouds
const float EARTH = 6360e3;      // m
const float LOWEST = -0.003;     // sine of the elevation down to which clouds are seen

vec2 cloud_place(vec2 place) { return (place + eye.xy - cloud_drift) / CLOUD_PERIOD; }

// Distance to a layer `up` m over the eye along a direction, on a spherical earth.
float to_layer(float up, float rise) { return 2.0 * up / (rise + sqrt(rise * rise + 2.0 * up / EARTH)); }

#if CLOUDS == 1
uniform sampler2D cloud_view;     // the dome: premultiplied radiance, transmittance
uniform vec3 cloud_origin;        // its origin relative to the eye, m
const float CLOUD_MIDDLE = 120.0; // m over the base, of the layer whose parallax is corrected

// Clouds in a direction, none below the horizon. Texels are directions in stereographic projection.
vec4 dome_clouds(vec3 direction)
{
    float share = smoothstep(LOWEST, 0.0, direction.z);
    direction = normalize(vec3(direction.xy, max(direction.z, 0.0)));
    float up = max(CLOUD_BASE + CLOUD_MIDDLE + view_range.y - eye.z, 300.0);
    vec3 seen = normalize(direction * to_layer(up, direction.z) - cloud_origin);
    vec2 at = 0.5 + 0.5 * seen.xy / (1.0 + max(seen.z, 0.0)), texel = 0.5 / vec2(textureSize(cloud_view, 0));
    // The mean of 2x2 rays, which start differently: a single one may be darker than any of a still.
    vec4 clouds = 0.25 * (textureLod(cloud_view, at + texel, 0.0) + textureLod(cloud_view, at - texel, 0.0)
        + textureLod(cloud_view, at + vec2(texel.x, -texel.y), 0.0) + textureLod(cloud_view, at + vec2(-texel.x, texel.y), 0.0));
    return share > 0.0 ? mix(vec4(0.0, 0.0, 0.0, 1.0), clouds, share) : vec4(0.0, 0.0, 0.0, 1.0);
}
#endif

// Density of the layer above a place (m, relative to the eye), 0..1.
float cloud_density(vec2 place)
{
#if CLOUDS == 0
    return 0.0;
#else
    return smoothstep(0.0, DENSE, texture(cloud_field, cloud_place(place)).r);
#endif
}

// Transmittance of the clouds for sunlight at a position (m, relative to the eye).
float cloud_shadow(vec3 place)
{
#if CLOUDS == 0
    return 1.0;
#else
    float up = CLOUD_BASE + view_range.y - eye.z - place.z;
    vec2 above = place.xy + to_sun.xy / max(to_sun.z, 0.05) * max(up, 0.0);
    return 1.0 - SHADE * smoothstep(-0.03, DENSE, textureLod(cloud_field, cloud_place(above), 0.0).r);
#endif
}
