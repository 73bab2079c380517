#version 430 core
// Mean of the samples of what is draped. In front of something farther, only some samples of a pixel are on the ground
// that is shaded for all of it: there the mean of those that are draped.
//   SAMPLES   of the G-buffer along each axis of a pixel
//   FRAGMENTS samples of what is draped, a pixel
#include "render/frame.glsl"
#include "render/gbuffer.glsl"

uniform sampler2DMS drawn;
uniform sampler2D ground_depth;
uniform float all_samples; // 1: the mean of all, everywhere

layout(location = 0) out vec4 colour;

float depth_at(ivec2 pixel)
{
    float depth;
    nearest_sample(ground_depth, clamp(pixel, ivec2(0), textureSize(drawn) - 1), depth);
    return depth;
}

// Depths of a plane change evenly.
bool is_in_front(ivec2 pixel, float here, ivec2 step)
{
    float one = depth_at(pixel - step) - here, other = depth_at(pixel + step) - here;
    return max(one, other) > min(abs(one), abs(other)) + NEARER * (1.0 - here);
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 sum = vec4(0.0);
    int count = 0;
    for (int k = 0; k < FRAGMENTS; ++k) {
        vec4 fragment = texelFetch(drawn, pixel, k);
        sum += fragment;
        count += fragment.a > 0.0 ? 1 : 0;
    }
    float here = depth_at(pixel);
    bool in_front = is_in_front(pixel, here, ivec2(1, 0)) || is_in_front(pixel, here, ivec2(0, 1));
    if (all_samples > 0.0 || count == 0 || !in_front) count = FRAGMENTS;
    colour = sum / float(count);
}
