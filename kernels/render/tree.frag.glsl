#version 430 core
// Leaves and bark, lit by sun and sky. Leaves are thin: what light they do not send back comes out at their other side,
// yellower; a crown is a cloud of them, so light wraps round it (a soft terminator) and glows through its rim.
//   SPRIGS 1: leaves are cut out of their sprays
#include "render/frame.glsl"
#include "render/shade.glsl"
#include "render/clouds.glsl"
#if SPRIGS
#include "render/sprig.glsl"
#endif

in vec3 position;
in vec4 leaf_normal;
in vec3 albedo;
in vec3 light;
in vec3 cut;
out vec4 radiance;

const float WRAP = 0.30;                         // how far light reaches round a crown, cosine
const vec3 THROUGH = vec3(1.15, 1.25, 0.35);     // colour of light that comes through a leaf, over its albedo
const float THROUGH_SHARE = 0.62;                // of it, against what is sent back
const float GLOW = 5.0;                          // how narrow the glow about the sun is
const float GLOSS = 0.10;                        // of leaves' wax
const float GLOSS_POWER = 14.0;
const float CROWN_EDGE = 0.5;                    // m, towards the sun: a leaf does not shade itself

void main()
{
    vec3 colour = albedo;
#if SPRIGS
    vec2 on_spray = vec2(cut.x * 2.0 - 1.0, cut.y);
    if (sprig(on_spray, cut.z) <= 0.0) discard;
    colour *= leaf_normal.w > 0.5 ? sprig_tone(on_spray, cut.z) : bark_tone(cut.xy, cut.z);
#endif
    vec3 n = normalize(leaf_normal.xyz);
    float leafy = leaf_normal.w;
    vec3 seen = normalize(position);
    float facing = dot(n, to_sun.xyz);
    float wrap = WRAP * leafy;
    float front = max(facing + wrap, 0.0) / ((1.0 + wrap) * (1.0 + wrap));
    float back = leafy * THROUGH_SHARE * (0.35 * max(-facing, 0.0) + 0.75 * pow(max(dot(seen, to_sun.xyz), 0.0), GLOW));
    float inner = mix(1.0, 0.5 + 0.5 * light.z, leafy);
    float sun = light.x * cloud_shadow(position) * tree_shade(position + to_sun.xyz * CROWN_EDGE, vec3(0.0)) * inner;
    vec3 lit = (colour * front + colour * THROUGH * back) / PI;
    float gloss = leafy * GLOSS * pow(max(dot(n, normalize(to_sun.xyz - seen)), 0.0), GLOSS_POWER);
    lit = (lit + gloss * 0.04) * sun_light.rgb * sun;
    // What leaves send to each other makes the light among them greener, and less dark than one bounce alone.
    vec3 among = colour / (1.0 - 0.75 * colour * (1.0 - light.z));
    lit += among / PI * sky_irradiance(normalize(n + vec3(0.0, 0.0, 0.3))) * light.y * light.z;
    radiance = vec4(through_air(lit, position), 1.0);
}
