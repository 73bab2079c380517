#version 430 core
// Leaves and bark: matt, and thin enough that light comes through.
#include "render/frame.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"

in vec3 position;
in vec3 leaf_normal;
in vec3 albedo;
in vec3 light;
out vec4 radiance;

void main()
{
    vec3 n = normalize(leaf_normal);
    float facing = dot(n, to_sun.xyz);
    float direct = max(facing * 0.8 + 0.2, 0.0) + 0.22 * max(-facing, 0.0);
    float sun = light.x * tree_shade(position + to_sun.xyz * 0.5, vec3(0.0)) * cloud_shadow(position);
    vec3 through = albedo * vec3(1.1, 1.15, 0.6) * pow(max(dot(normalize(position), to_sun.xyz), 0.0), 4.0) * 0.5;
    vec3 lit = (albedo * direct + through) / PI * sun_light.rgb * sun * (0.45 + 0.55 * light.z);
    lit += albedo / PI * sky_irradiance(n) * light.y * light.z;
    radiance = vec4(through_air(lit, position), 1.0);
}
