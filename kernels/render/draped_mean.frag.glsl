#version 430 core
// Mean of the samples of what is draped, over those of the pixel's samples that are on the ground that is shaded.
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

// How much depths change from pixel to pixel on a plane; where it ends there is less on one side.
float slope(ivec2 pixel, float here, ivec2 step)
{
    return min(abs(depth_at(pixel - step) - here), abs(depth_at(pixel + step) - here));
}

// Share of a pixel's samples that are not on farther ground behind that of depth `here`.
float share_in_front(ivec2 pixel, float here)
{
    float most = here + slope(pixel, here, ivec2(1, 0)) + slope(pixel, here, ivec2(0, 1)) + NEARER * (1.0 - here);
    int count = 0;
    for (int k = 0; k < SAMPLES * SAMPLES; ++k) {
        ivec2 at = pixel * SAMPLES + ivec2(k % SAMPLES, k / SAMPLES);
        count += texelFetch(ground_depth, at, 0).r <= most ? 1 : 0;
    }
    return float(count) / float(SAMPLES * SAMPLES);
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 sum = vec4(0.0);
    for (int k = 0; k < FRAGMENTS; ++k) sum += texelFetch(drawn, pixel, k);
    float share = all_samples > 0.0 ? 1.0 : share_in_front(pixel, depth_at(pixel));
    colour = sum / (float(FRAGMENTS) * share);
    colour /= max(colour.a, 1.0);
}
