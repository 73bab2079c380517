#version 430 core
// A vertex of a stone.
#include "render/frame.glsl"
#include "render/rock_spin.glsl"

in vec3 place;   // radii
in vec3 outward; // unit normal

in vec4 stand; // of the stone, captured from rock_place.vert.glsl
in vec4 spin;
in vec4 ground;
in vec4 kind;

out vec3 position;
out vec3 normal;
out vec3 on_stone;  // m, fixed to the stone
out vec3 own_normal;
out vec4 stone;     // xy: of kind; z: m over the ground; w: radius, m
out vec4 light;     // xyz: ground's normal; w: share of the sun
out float sky_share;

void main()
{
    vec3 at = spun(spin, place) * stand.w;
    position = stand.xyz + at;
    normal = spun(spin, outward);
    on_stone = place * stand.w + 7.3 * spin.xyz;
    own_normal = outward;
    stone = vec4(kind.xy, ground.w + dot(at, ground.xyz), stand.w);
    light = vec4(ground.xyz, kind.z);
    sky_share = kind.w;
    gl_Position = to_clip * vec4(position, 1.0);
}
