#version 430 core
// A draped feature where the ground that it lies on is what the picture shows.
//   SAMPLES  of the G-buffer along each axis of a pixel
#include "render/frame.glsl"
#include "render/draped.glsl"

uniform sampler2D ground_depth;
uniform float share; // 0 ... 1: cross-fades

in vec2 part_place;
in vec3 from_eye;
flat in uint part_number;

layout(location = 0) out vec4 colour;

const float NEARER = 0.002; // share of the distance within which the ground does not hide what lies on it

float distance_of(float depth)
{
    vec4 row = vec4(from_clip[0].w, from_clip[1].w, from_clip[2].w, from_clip[3].w);
    return 1.0 / (row.z * (2.0 * depth - 1.0) + row.w);
}

void main()
{
    mat2 change = mat2(dFdx(part_place), dFdy(part_place));
    float away = 1.0 / gl_FragCoord.w;
    float steep = fwidth(away);
    colour = share * draped_colour(part_place, change, draped_parts[part_number], length(from_eye) * trees.z);
    ivec2 pixel = ivec2(gl_FragCoord.xy) * SAMPLES;
    float depth = 1.0;
    for (int k = 0; k < SAMPLES * SAMPLES; ++k)
        depth = min(depth, texelFetch(ground_depth, pixel + ivec2(k % SAMPLES, k / SAMPLES), 0).r);
    if (away > distance_of(depth) * (1.0 + NEARER) + steep) discard;
    if (colour.a <= 0.0) discard;
}
