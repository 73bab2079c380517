#version 430 core
// A stone with triplanar rock texture in its own frame, darkened where it meets the ground.
#include "render/frame.glsl"
#include "render/surface.glsl"
#include "render/triplanar.glsl"
#include "render/shade.glsl"

uniform sampler2DArray material_colour;
uniform sampler2DArray material_relief;

in vec3 position;
in vec3 normal;
in vec3 on_stone;
in vec3 own_normal;
in vec4 stone;
in vec4 light;
in vec3 mean_albedo;
out vec4 radiance;

const float TEXTURE = 1.7;       // m, width of the texture on a stone
const float SPAN = 0.55;         // radii over which the ground's occlusion ends
const float DEEP = 0.30;         // light left where stone meets ground
const float FACETS = 0.5;        // flat shading of unworn stones

void main()
{
    vec3 planes = triplanar_weights(own_normal);
    vec3 albedo = vec3(0.0);
    vec3 bump = vec3(0.0);
    float open = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
        vec2 at = (axis == 0 ? on_stone.yz : axis == 1 ? on_stone.xz : on_stone.xy) / TEXTURE;
        vec4 colour = texture(material_colour, vec3(at, float(BEDROCK)));
        vec4 relief = texture(material_relief, vec3(at, float(BEDROCK)));
        albedo += planes[axis] * colour.rgb * colour.rgb;
        open += planes[axis] * relief.a;
        vec2 slope = (relief.xy - 0.5) * 2.0;
        vec3 turned = axis == 0 ? vec3(0.0, slope) : axis == 1 ? vec3(slope.x, 0.0, slope.y) : vec3(slope, 0.0);
        bump += planes[axis] * turned;
    }
    vec3 mean = textureLod(material_colour, vec3(0.5, 0.5, float(BEDROCK)), 20.0).rgb;
    albedo *= mean_albedo / (mean * mean);
    vec3 face = normalize(cross(dFdx(position), dFdy(position)));
    vec3 smoothed = normalize(normal);
    face *= sign(dot(face, smoothed));
    vec3 n = normalize(mix(smoothed, face, FACETS * (1.0 - stone.x)) + 0.55 * bump);
    float above = stone.z / (SPAN * stone.w);
    float hidden = 0.5 + 0.5 * dot(n, light.xyz);
    float clear = mix(DEEP, 1.0, smoothstep(-0.25, 1.0, above + 0.5 * hidden));
    vec3 to_eye = -normalize(position);
    float sun = light.w * tree_shade(position, n) * mix(smoothstep(-0.3, 0.25, above), 1.0, 0.35);
    float roughness = mix(0.85, 0.55, stone.x);
    vec3 lit = reflectance(albedo, vec3(0.03), roughness, n, to_eye, to_sun.xyz) * sun_light.rgb * sun;
    lit += albedo / PI * sky_irradiance(n) * stone.y * open * clear;
    radiance = vec4(through_air(lit, position), 1.0);
}
