#version 430 core
// What lies behind everything: the sky, its clouds and the sun.
#include "render/frame.glsl"
#include "render/clouds.glsl"

in vec2 uv;
out vec4 radiance;

vec3 with_clouds(vec3 sky, vec3 direction)
{
    float up = max(CLOUD_BASE + reach.y - eye.z, 300.0);
    // The earth's curve keeps the layer's distance finite at the horizon.
    float distance = up / (direction.z + 0.012);
    vec2 place = direction.xy * distance;
    float density = cloud_density(place);
    vec2 sunward = to_sun.xy / max(length(to_sun.xy), 1e-4);
#if MATERIALS == 1
    float ahead = cloud_density_plain(place + sunward * 600.0);
#else
    float ahead = 0.5 * cloud_density(place + sunward * 350.0) + 0.5 * cloud_density(place + sunward * 900.0);
#endif
    float cosine = dot(direction, to_sun.xyz);
    float forward = 0.6 + 1.6 * pow(max(cosine, 0.0), 8.0);
    vec3 lit = sun_light.rgb * (0.26 * forward) * exp(-1.5 * ahead - 0.35 * density) ;
    vec3 body = lit + sky_irradiance(vec3(0.0, 0.0, -0.2)) * 0.16 + sky_irradiance(vec3(0.0, 0.0, 1.0)) * 0.20;
    float cover = density * (0.55 + 0.45 * density);
    cover *= exp(-distance / 26000.0) * smoothstep(0.0, 0.06, direction.z);

    vec2 wisp_at = (direction.xy / (direction.z + 0.06) * 7500.0 + eye.xy) / 65536.0;
    wisp_at = mat2(0.8, 0.6, -0.6, 0.8) * wisp_at;
    float veil = texture(noise_field, wisp_at * vec2(1.2, 4.5)).w + 0.5 * texture(noise_field, wisp_at * vec2(4.0, 11.0) + 0.5).x;
    float wisps = smoothstep(0.0, 1.5, veil) * 0.30 * smoothstep(0.02, 0.25, direction.z);
    sky = mix(sky, sun_light.rgb * 0.19 * (0.8 + forward * 0.4) + sky * 0.5, wisps);
    return mix(sky, body, cover);
}

const float SUN_RADIUS = 0.00466; // rad
const float SUN_BRIGHT = 60.0;    // of the disc's middle, over the sun's irradiance: 1/4000 of the truth, all that a picture holds

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
    // Below the horizon the world has ended in air.
    vec3 sky = direction.z > 0.0 ? clear_sky(direction) : air_light(direction);
    float cosine = dot(direction, to_sun.xyz);
    sky += sun_light.rgb * sun_disc(cosine) * smoothstep(-0.002, 0.002, direction.z);
    sky = with_clouds(sky, normalize(vec3(direction.xy, max(direction.z, 0.009))));
    radiance = vec4(sky, 1e6);
}
