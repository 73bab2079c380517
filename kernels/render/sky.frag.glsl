#version 430 core
// Background: sky, clouds and sun.
#include "render/frame.glsl"
#include "render/clouds.glsl"
#include "render/cloud_light.glsl"

in vec2 uv;
out vec4 radiance;

#if CLOUDS == 2
uniform sampler2D cloud_view; // premultiplied radiance, transmittance (clouds.frag.glsl)
#endif

#if CIRRUS
uniform float cirrus;     // share of the sky

const float ICE = 9500.0; // m above the haze's base
const float VEIL = 0.75;  // opacity of the thickest
const float FEW = 0.3;    // share below which they become thinner, not fewer
const float BEND = 0.07;  // of fibres, periods of the noise across the jet
const float SMOOTHED = 4.8; // level of the noise that banks and bends follow

// Thin ice clouds: banks of fibres that fall through wind shear, along a jet. Noise coordinates are whole multiples of the
// eye's, which is passed modulo its period.
vec3 with_cirrus(vec3 sky, vec3 direction)
{
    vec2 at = (direction.xy * to_layer(ICE, direction.z) + eye.xy - 2.0 * cloud_drift) / 65536.0;
    vec2 jet = vec2(at.x + at.y, 2.0 * (at.y - at.x));
    vec4 banks = textureLod(noise_field, jet, SMOOTHED);
    vec2 bent = jet + vec2(0.0, BEND * banks.w);
#if CLOUDS == 1
    float fibres = banks.x;
#else
    float fibres = texture(noise_field, bent * vec2(2.0, 9.0)).x;
#endif
#if CLOUDS == 0
    fibres = 0.7 * fibres + 0.5 * texture(noise_field, bent * vec2(5.0, 31.0) + 0.5).y;
#endif
    float edge = 0.7 - 2.0 * max(cirrus, FEW);
    float thick = min(cirrus / FEW, 1.0) * smoothstep(edge, edge + 1.9, 1.1 * banks.z + 0.5 * banks.w + 0.45 * fibres);
    float veil = VEIL * thick * (0.3 + 0.7 * smoothstep(-1.2, 1.2, fibres)) * smoothstep(0.02, 0.2, direction.z);
    vec3 lit = cloud_sun * (0.6 * scattered(dot(direction, to_sun.xyz), 0.7) + 0.045);
    return mix(sky, lit + sky_irradiance(vec3(0.0, 0.0, 1.0)) * 0.12, veil);
}
#endif

#if GREY
// Brightness variation of an overcast sky.
float grey_structure(vec3 direction)
{
    vec2 place = direction.xy * to_layer(1500.0, direction.z);
    float waves = textureLod(noise_field, cloud_place(place) * 3.0, 2.0).x
        + 0.5 * textureLod(noise_field, cloud_place(place) * vec2(6.0, 9.0), 1.0).y;
    return 1.0 + 0.22 * overcast * waves * smoothstep(0.0, 0.25, direction.z);
}
#endif

const float SUN_RADIUS = 0.00466; // rad
const float SUN_BRIGHT = 60.0;    // radiance of the disc's middle over the sun's irradiance: 1/4000 of the real one, enough for a picture

// The disc, darker towards its limb (Nordlund, 550 nm: 1 - 0.6 (1 - cos)); `cosine` to its middle.
float sun_disc(float cosine)
{
    float off = sqrt(max(2.0 - 2.0 * cosine, 0.0)) / SUN_RADIUS;
    float inner = sqrt(max(1.0 - off * off, 0.0));
    return SUN_BRIGHT * (1.0 - 0.6 * (1.0 - inner)) * (1.0 - smoothstep(0.85, 1.15, off));
}

void main()
{
    vec4 far_point = from_clip * vec4(uv * 2.0 - 1.0, 1.0, 1.0);
    vec3 direction = normalize(far_point.xyz / far_point.w);
    // Below the horizon the world fades into air.
    vec3 sky = direction.z > 0.0 ? clear_sky(direction) : air_light(direction);
    float cosine = dot(direction, to_sun.xyz);
    sky += sun_light.rgb * sun_disc(cosine) * smoothstep(-0.002, 0.002, direction.z);
    vec3 above = normalize(vec3(direction.xy, max(direction.z, 0.0)));
#if GREY
    sky *= grey_structure(above);
#endif
#if CIRRUS
    sky = with_cirrus(sky, above);
#endif
#if CLOUDS == 1
    vec4 clouds = dome_clouds(direction);
    sky = sky * clouds.a + clouds.rgb;
#elif CLOUDS == 2
    vec2 texel = 0.5 / vec2(textureSize(cloud_view, 0)); // averages 2x2 rays, which start differently
    vec4 clouds = 0.25 * (texture(cloud_view, uv + texel) + texture(cloud_view, uv - texel)
        + texture(cloud_view, uv + vec2(texel.x, -texel.y)) + texture(cloud_view, uv + vec2(-texel.x, texel.y)));
    sky = sky * clouds.a + clouds.rgb;
#endif
    radiance = vec4(sky, 1e6);
}
