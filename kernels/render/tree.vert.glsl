#version 430 core
// One vertex of one plant.
#include "render/frame.glsl"

uniform vec3 anchor; // of all plants, relative to the eye, m

in vec3 place;   // in heights of the plant, from its foot
in vec3 outward; // normal
in vec4 colour;  // rgb: √albedo, a: openness to the sky
in vec4 stand;   // xyz: foot, m from the anchor; w: height, m
in vec4 manner;  // xy: cosine and sine of its rotation; z: tint -1..1; w: unused

out vec3 position;
out vec3 leaf_normal;
out vec3 albedo;
out vec3 light; // x: sun over the bare ground, y: sky over it, z: openness within the plant

void main()
{
    mat2 turn = mat2(manner.x, manner.y, -manner.y, manner.x);
    vec3 foot = anchor + stand.xyz;
    position = foot + stand.w * vec3(turn * place.xy, place.z);
    leaf_normal = vec3(turn * outward.xy, outward.z);
    vec3 warm = mix(vec3(0.78, 0.88, 0.92), vec3(1.28, 1.10, 0.80), 0.5 + 0.5 * manner.z);
    albedo = colour.rgb * colour.rgb * warm;
    light = vec3(ground_light(foot.xy).rg, colour.a);
    gl_Position = to_clip * vec4(position, 1.0);
}
