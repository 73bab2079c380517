#version 430 core
// Water: mirrors sky and banks, shows its bed where it is shallow, ripples that drift downstream.
#include "render/frame.glsl"
#include "render/surface.glsl"
#include "render/clouds.glsl"

uniform sampler2D scene;        // all that is drawn already: radiance
uniform sampler2D scene_depth;  // and its depth buffer
uniform sampler2D near_heights; // m
uniform float clock;            // s

in vec3 position;
in vec4 flow;
in float wet_room;
in float nearer;
out vec4 radiance;

const vec3 ABSORPTION = vec3(0.95, 0.34, 0.26); // 1/m, of a river that carries a little silt
const vec3 SILT = vec3(0.020, 0.034, 0.028);    // light scattered back, share of what comes in
// Steps along a mirrored ray, each so many times as long as the last: 1 to 2 km.
#if MATERIALS == 1
const int MARCH = 12;
const float STRIDE = 1.65;
#else
const int MARCH = 40;
const float STRIDE = 1.15;
#endif

float relief_at(vec2 place)
{
    vec2 at = (place - near_map.xy) * near_map.z;
    return textureLod(near_heights, at, 0.0).r - eye.z;
}

vec3 scene_position(vec2 uv)
{
    vec4 p = from_clip * vec4(vec3(uv, texture(scene_depth, uv).r) * 2.0 - 1.0, 1.0);
    return p.xyz / p.w;
}

// Slope of the ripples: three trains of noise that drift downstream at different speeds.
vec2 ripples(float distance)
{
    vec2 across = vec2(-flow.w, flow.z);
    vec2 sum = vec2(0.0);
    float size = 3.1;
    for (int i = 0; i < 3; ++i) {
        vec2 at = vec2(flow.x / size, (flow.y - clock * (0.6 + 0.2 * float(i))) / (1.7 * size)) * 0.12 + 0.37 * float(i);
        float e = 0.006;
        float h = texture(noise_field, at).x;
        vec2 d = vec2(texture(noise_field, at + vec2(e, 0.0)).x - h, texture(noise_field, at + vec2(0.0, e)).x - h) / e;
        sum += 0.0030 * (across * d.x + flow.zw * d.y);
        size *= 2.9;
    }
    return sum / (1.0 + distance * 0.0035);
}

// Radiance that comes from a direction above the water: banks and mountains where the height map is hit, else sky.
vec3 mirrored(vec3 direction)
{
    vec3 sky = clear_sky(direction);
    float up = max(CLOUD_BASE + reach.y - eye.z, 300.0);
    float density = cloud_density(direction.xy * up / (direction.z + 0.02));
    sky = mix(sky, sun_light.rgb * 0.14, 0.6 * density * smoothstep(0.0, 0.1, direction.z));
    float gone = 2.0;
    float before = 0.0;
    float hit = -1.0;
    for (int i = 0; i < MARCH; ++i) {
        vec3 p = position + direction * gone;
        if (hit < 0.0 && p.z < relief_at(p.xy) - 0.4) hit = 0.5 * (before + gone);
        before = gone;
        gone = gone * STRIDE + 1.0;
    }
    if (hit < 0.0) return sky;
    vec3 p = position + direction * hit;
    vec4 clip = to_clip * vec4(p, 1.0);
    vec2 uv = clip.xy / clip.w * 0.5 + 0.5;
    vec4 light = ground_light(p.xy);
    vec3 bank = vec3(0.062, 0.070, 0.034) / PI * (sun_light.rgb * to_sun.z * light.r + sky_irradiance(vec3(0, 0, 1)) * light.g);
    bank = through_air(bank, p);
    vec2 margin = abs(uv - 0.5);
    float known = clip.w > 0.0 ? 1.0 - smoothstep(0.44, 0.5, max(margin.x, margin.y)) : 0.0;
    float seen = length(scene_position(uv));
    known *= 1.0 - smoothstep(0.05, 0.2, abs(seen - length(p)) / length(p));
    return mix(bank, texture(scene, uv).rgb, known);
}

void main()
{
    if (wet_room < 0.0) discard;
    float distance = length(position);
    vec3 to_eye = -position / distance;
    vec3 normal = normalize(vec3(-ripples(distance), 1.0));
    vec2 uv = gl_FragCoord.xy / reach.zw;

    vec2 bent = uv + normal.xy * 0.03;
    float from = distance * (1.0 - nearer);
    float depth = length(scene_position(bent)) - from;
    bent = depth > 0.0 ? bent : uv;
    depth = max(length(scene_position(bent)) - from, 0.0);
    vec3 bed = texture(scene, bent).rgb;

    vec4 light = ground_light(position.xy);
    vec3 incoming = sun_light.rgb * to_sun.z * light.r * cloud_shadow(position) + sky_irradiance(vec3(0.0, 0.0, 1.0)) * light.g;
    vec3 clear = exp(-ABSORPTION * min(depth, 60.0) * 0.8);
    vec3 body = mix(through_air(SILT * incoming, position), bed, clear);

    vec3 back = reflect(-to_eye, normal);
    back.z = max(abs(back.z), 0.01);
    float fresnel = schlick(vec3(0.02), dot(normal, to_eye)).r;
    vec3 half_way = normalize(to_eye + to_sun.xyz);
    float glint = trowbridge_reitz(max(dot(normal, half_way), 0.0), 0.03) * fresnel * 0.15 * light.r;
    vec3 mirror = mirrored(normalize(back)) + sun_light.rgb * min(glint, 4.0);
    float wet = smoothstep(0.0, 0.25, depth);
    radiance = vec4(mix(body, mix(body, mirror, fresnel), wet), 1.0);
}
