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
in vec4 hue;

out vec3 position;
out vec3 normal;
out vec3 on_stone;  // m, fixed to the stone
out vec3 own_normal;
out vec4 stone;     // x: how far it is worn; y: share of the sky; z: m over the ground; w: radius, m
out vec4 light;     // xyz: ground's normal; w: share of the sun
out vec3 mean_albedo;

void main()
{
    vec3 at = spun(spin, place) * stand.w;
    position = stand.xyz + at;
    normal = spun(spin, outward);
    on_stone = place * stand.w + 7.3 * spin.xyz;
    own_normal = outward;
    stone = vec4(kind.xz, ground.w + dot(at, ground.xyz), stand.w);
    light = vec4(ground.xyz, kind.y);
    mean_albedo = hue.rgb;
    gl_Position = to_clip * vec4(position, 1.0);
}
