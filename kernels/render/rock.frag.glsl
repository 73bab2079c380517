#version 430 core
// A stone, textured from three sides in its own frame with the ground's rock, dark where it meets the ground.
#include "render/frame.glsl"
#include "render/surface.glsl"
#include "render/triplanar.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#include "render/variety.glsl"

uniform sampler2DArray material_colour;
uniform sampler2DArray material_relief;

in vec3 position;
in vec3 normal;
in vec3 on_stone;
in vec3 own_normal;
in vec4 stone;
in vec4 light;
in float sky_share;
out vec4 radiance;

const float TEXTURE = 1.7;       // m, width of the texture on a stone
const float SPAN = 0.55;         // radii over which the ground's shade ends
const float DEEP = 0.30;         // light left where stone meets ground
const float RIVER_DARK = 0.62;   // albedo of a river's stones over dry ones'
const vec3 RIVER_HUE = vec3(0.96, 1.0, 1.02);

void main()
{
    vec3 planes = triplanar_weights(own_normal);
    vec3 albedo = vec3(0.0);
    vec3 bump = vec3(0.0);
    float open = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
        vec2 at = (axis == 0 ? on_stone.yz : axis == 1 ? on_stone.xz : on_stone.xy) / TEXTURE;
        vec4 colour = texture(material_colour, vec3(at, float(ROCK)));
        vec4 relief = texture(material_relief, vec3(at, float(ROCK)));
        albedo += planes[axis] * colour.rgb * colour.rgb;
        open += planes[axis] * relief.a;
        vec2 slope = (relief.xy - 0.5) * 2.0;
        vec3 turned = axis == 0 ? vec3(0.0, slope) : axis == 1 ? vec3(slope.x, 0.0, slope.y) : vec3(slope, 0.0);
        bump += planes[axis] * turned;
    }
    vec2 world = position.xy + eye.xy;
    albedo *= variety(ROCK, textureLod(noise_field, world / 4096.0, 0.0), textureLod(noise_field, world / 512.0 + 0.37, 0.0),
        textureLod(noise_field, world / 64.0 + 0.71, 0.0));
    albedo *= mix(0.78, 1.22, stone.x) * mix(vec3(1.0), RIVER_DARK * RIVER_HUE, stone.y);
    vec3 n = normalize(normalize(normal) + 0.55 * bump);
    float above = stone.z / (SPAN * stone.w);
    float hidden = 0.5 + 0.5 * dot(n, light.xyz);
    float clear = mix(DEEP, 1.0, smoothstep(-0.25, 1.0, above + 0.5 * hidden));
    vec3 to_eye = -normalize(position);
    float sun = light.w * tree_shade(position, n) * mix(smoothstep(-0.3, 0.25, above), 1.0, 0.35);
    float roughness = mix(0.85, 0.55, stone.y);
    vec3 lit = reflectance(albedo, vec3(0.03), roughness, n, to_eye, to_sun.xyz) * sun_light.rgb * sun;
    lit += albedo / PI * sky_irradiance(n) * sky_share * open * clear;
    radiance = vec4(through_air(lit, position), 1.0);
}
