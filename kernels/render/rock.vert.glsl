#version 430 core
// A vertex of a stone.
#include "render/frame.glsl"
#include "render/rock_spin.glsl"

in vec3 local_position; // radii
in vec3 local_normal; // unit normal

in vec4 centre_radius; // of the stone, captured from rock_place.vert.glsl
in vec4 spin;
in vec4 ground;
in vec4 kind;
in vec4 hue;

out vec3 position;
out vec3 normal;
out vec3 on_stone;  // m, fixed to the stone
out vec3 own_normal;
out vec4 stone;     // x: wear; y: sky visibility; z: m over the ground; w: radius, m
out vec4 light;     // xyz: ground's normal; w: sun visibility
out vec3 mean_albedo;

void main()
{
    vec3 at = spun(spin, local_position) * centre_radius.w;
    position = centre_radius.xyz + at;
    normal = spun(spin, local_normal);
    on_stone = local_position * centre_radius.w + 7.3 * spin.xyz;
    own_normal = local_normal;
    stone = vec4(kind.xz, ground.w + dot(at, ground.xyz), centre_radius.w);
    light = vec4(ground.xyz, kind.y);
    mean_albedo = hue.rgb;
    gl_Position = to_clip * vec4(position, 1.0);
}
