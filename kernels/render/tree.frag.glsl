#version 430 core
// Nearby leaves and bark, lit by sun and sky (tree_light.glsl).
//   SPRIGS 1: leaves are alpha-masked
#include "render/frame.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#include "render/tree_light.glsl"
#if SPRIGS
#include "render/sprig.glsl"
#endif

in vec3 position;
in vec4 leaf_normal;
in vec3 albedo;
in vec3 light;
in vec3 spray;
out vec4 radiance;

const float CROWN_EDGE = 0.5;                    // m towards the sun, against self-shadowing

void main()
{
    vec3 colour = albedo;
#if SPRIGS
    vec2 on_spray = vec2(spray.x * 2.0 - 1.0, spray.y);
    if (leaf_mask(on_spray, spray.z) <= 0.0) discard;
    colour *= leaf_normal.w > 0.5 ? leaf_tone(on_spray, spray.z) : bark_tone(spray.xy, spray.z);
#endif
    float sun = light.x * cloud_shadow(position) * tree_shade(position + to_sun.xyz * CROWN_EDGE, vec3(0.0));
    vec3 lit = leaf_light(colour, normalize(leaf_normal.xyz), leaf_normal.w, normalize(position), sun, light.y, light.z);
    radiance = vec4(through_air(lit, position), 1.0);
}
