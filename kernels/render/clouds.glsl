// A layer of fair-weather clouds, the same for the sky and for the shadows that it throws.
// MATERIALS: 1 where it is to be cheap, as in shade_ground.frag.glsl.
#ifndef MATERIALS
#define MATERIALS 2
#endif
uniform sampler2D noise_field;  // textures.py: tileable_noise
uniform float cloud_cover;      // 0 clear … 1 overcast
const float CLOUD_BASE = 1900.0; // m above the haze's base

// Density of the layer above a place (m, relative to the eye), 0..1.
float cloud_density(vec2 place)
{
    vec2 at = (place + eye.xy) / 16384.0;
    float shape = texture(noise_field, at).x + 0.55 * texture(noise_field, at * 4.0 + 0.31).y
        + 0.28 * texture(noise_field, at * 13.0 + 0.77).z;
    float edge = 1.15 - 1.9 * cloud_cover;
    return smoothstep(edge, edge + 0.75, shape);
}

// The same at one look-up, without its finer structure.
float cloud_density_plain(vec2 place)
{
    float edge = 1.15 - 1.9 * cloud_cover;
    return smoothstep(edge - 0.1, edge + 0.65, texture(noise_field, (place + eye.xy) / 16384.0).x);
}

float cloud_shadow(vec3 place)
{
    float up = CLOUD_BASE + reach.y - eye.z - place.z;
    vec2 above = place.xy + to_sun.xy / max(to_sun.z, 0.05) * max(up, 0.0);
#if MATERIALS == 1
    return 1.0 - 0.42 * cloud_density_plain(above);
#else
    return 1.0 - 0.42 * cloud_density(above);
#endif
}
