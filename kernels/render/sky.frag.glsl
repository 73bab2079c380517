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

void main()
{
    vec4 far_point = from_clip * vec4(uv * 2.0 - 1.0, 1.0, 1.0);
    vec3 direction = normalize(far_point.xyz / far_point.w);
    vec3 above = normalize(vec3(direction.xy, max(direction.z, 0.015 * 0.6)));
    vec3 sky = clear_sky(direction.z > 0.015 ? direction : normalize(vec3(direction.xy, 0.015)));
    sky = with_clouds(sky, above);
    float cosine = dot(direction, to_sun.xyz);
    sky += sun_light.rgb * (smoothstep(0.99994, 0.99998, cosine) * 60.0 + 0.35 * pow(max(cosine, 0.0), 900.0));
    radiance = vec4(sky, 1e6);
}
