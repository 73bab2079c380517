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
flat in uint spray_random;
out vec4 radiance;

const float CROWN_EDGE = 0.5;                    // m towards the sun, against self-shadowing
const float HOLES = 50.0;                        // m, distance over which light through a crown's holes is resolved
const float TILT = 0.9;                          // of leaves out of their spray's plane

void main()
{
    vec3 colour = albedo, normal = leaf_normal.xyz;
    float open = mix(light.z, sqrt(light.z), leaf_normal.w * exp(-length(position) / HOLES));
#if SPRIGS
    vec2 on_spray = vec2(spray.x * 2.0 - 1.0, spray.y);
    vec2 leaves = fwidth(on_spray) * (spray.z > 0.75 ? FRINGE.yx : PAIRS.yx * vec2(1.0, 2.0)); // a pixel
    vec2 leaf = leaf_mask(on_spray, spray.z, spray_random, max(leaves.x, leaves.y) > COARSE ? 2.0 : 1.0);
    if (leaf.x <= 0.0) discard;
    if (leaf_normal.w > 0.5)
    {
        colour *= leaf_tone(leaf.y, on_spray);
        normal += TILT * (fract(leaf.y * vec3(5.0, 11.0, 23.0)) - 0.5);
    }
    else
        colour *= bark_tone(spray.xy, spray.z);
#endif
    float sun = light.x * cloud_shadow(position) * tree_shade(position + to_sun.xyz * CROWN_EDGE, vec3(0.0));
    vec3 lit = leaf_light(colour, normalize(normal), leaf_normal.w, normalize(position), sun, light.y, open);
    radiance = vec4(through_air(lit, position), 1.0);
}
