#version 430 core
// Wet banks: ground slightly above the water is darker and smoother. Blended as radiance + alpha * background.
// Wet ground is darker because light is trapped by internal reflection in the film (Lekner & Dorf 1988).
#include "render/frame.glsl"
#include "render/surface.glsl"
#include "render/water_wetness.glsl"

uniform sampler2D scene_depth; // of the scene so far
uniform sampler2D gbuffer_normal;
uniform sampler2D noise_field;

in vec3 position;
in vec4 strip;
in float visible;
out vec4 radiance;

const float WET = 0.6;        // albedo of wet over dry ground
const float ENDING = 0.8;     // share of the surface in the bank over which wetness fades out
const float UNEVEN = 0.22;    // m, standard deviation of the noise
const float SHEEN = 0.10;     // reflectance of the film over a full one
const float FAR = 500.0;      // m, where the displayed ground is too coarse for it

void main()
{
    vec2 uv = gl_FragCoord.xy / view_range.zw;
    vec4 p = from_clip * vec4(vec3(uv, textureLod(scene_depth, uv, 0.0).r) * 2.0 - 1.0, 1.0);
    vec3 ground = p.xyz / p.w;
    vec3 normal = normalize(textureLod(gbuffer_normal, uv, 0.0).xyz + vec3(0.0, 0.0, 1e-4));
    float above = ground.z - position.z;
    vec2 at = ground.xy + eye.xy;
    vec4 wide = texture(noise_field, at / 128.0);
    vec4 fine = texture(noise_field, at / 16.0);
    float uneven = UNEVEN * (wide.x + 0.7 * fine.y);
    // Of the ground behind the surface, along which they change evenly.
    float room = strip.w > 0.0 ? strip.z : strip.x;
    room += dot(inverse(mat2(dFdx(position.xy), dFdy(position.xy))) * (ground.xy - position.xy), vec2(dFdx(room), dFdy(room)));
    if (strip.w > 0.0) room = strip.w - abs(room);
    float wet = visible * smoothstep(0.0, ENDING, 1.0 + min(room, 0.0) / max(strip.y, 0.01))
        * wetness_beside(above, room, uneven) * (1.0 - smoothstep(0.4 * FAR, FAR, length(ground)));
    vec3 to_eye = -normalize(ground);
    float mirror = SHEEN * wet * schlick(vec3(0.02), dot(normal, to_eye)).r * smoothstep(-0.1, 0.1, above);
    vec3 clear = through_air(vec3(1.0), ground) - through_air(vec3(0.0), ground);
    radiance = vec4(mirror * ground_light(ground.xy).g * clear * clear_sky(normalize(vec3(reflect(-to_eye, normal).xy, 0.3))),
        mix(1.0, mix(1.0, WET, wet), clear.g));
}
