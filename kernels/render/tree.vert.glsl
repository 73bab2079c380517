#version 430 core
// One vertex of one plant. A plant that comes, goes or passes into another detail loses its triangles one by one.
#include "render/frame.glsl"

uniform vec3 anchor; // of all plants, relative to the eye, m

in vec3 place;   // in heights of the plant, from its foot
in vec3 outward; // normal
in vec4 colour;  // rgb: √albedo, a: openness to the sky
in vec4 stand;   // xyz: foot, m from the anchor; w: height, m
in vec4 manner;  // xy: cosine and sine of its rotation; z: tint -1..1; w: share of its triangles that is drawn

out vec3 position;
out vec3 leaf_normal;
out vec3 albedo;
out vec3 light; // x: sun over the bare ground, y: sky over it, z: openness within the plant

// 0..1 for a triangle of a plant.
float draw_of(int triangle, float tint)
{
    uint h = uint(triangle) * 0x9e3779b9u ^ floatBitsToUint(tint);
    h ^= h >> 16; h *= 0x7feb352du; h ^= h >> 15;
    return float(h & 0xffffu) / 65536.0;
}

void main()
{
    mat2 turn = mat2(manner.x, manner.y, -manner.y, manner.x);
    vec3 foot = anchor + stand.xyz;
    position = foot + stand.w * vec3(turn * place.xy, place.z);
    leaf_normal = vec3(turn * outward.xy, outward.z);
    vec3 warm = mix(vec3(0.78, 0.88, 0.92), vec3(1.28, 1.10, 0.80), 0.5 + 0.5 * manner.z);
    albedo = colour.rgb * colour.rgb * warm;
    light = vec3(ground_light(foot.xy).rg, colour.a);
    gl_Position = draw_of(gl_VertexID / 3, manner.z) < manner.w ? to_clip * vec4(position, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
}
