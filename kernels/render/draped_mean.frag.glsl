#version 430 core
// Mean of the samples of what is draped. At silhouettes only some samples of a pixel are on the ground that is shaded
// for all of it: there the mean of those that are draped.
//   SAMPLES   of the G-buffer along each axis of a pixel
//   FRAGMENTS samples of what is draped, a pixel
#include "render/frame.glsl"
#include "render/gbuffer.glsl"

uniform sampler2DMS drawn;
uniform sampler2D ground_depth;

layout(location = 0) out vec4 colour;

float depth_at(ivec2 pixel)
{
    float depth;
    nearest_sample(ground_depth, clamp(pixel, ivec2(0), textureSize(drawn) - 1), depth);
    return depth;
}

// Whether some of a pixel is on farther ground behind that of depth `here`.
bool is_silhouette(ivec2 pixel, float here)
{
    vec4 change = vec4(depth_at(pixel - ivec2(1, 0)), depth_at(pixel - ivec2(0, 1)),
        depth_at(pixel + ivec2(1, 0)), depth_at(pixel + ivec2(0, 1))) - here;
    vec2 slope = min(abs(change.xy), abs(change.zw)); // of a plane, which changes evenly
    float room = NEARER * (1.0 - here);
#if SAMPLES > 1
    float farthest = here;
    for (int k = 0; k < SAMPLES * SAMPLES; ++k) {
        ivec2 at = pixel * SAMPLES + ivec2(k % SAMPLES, k / SAMPLES);
        farthest = max(farthest, texelFetch(ground_depth, at, 0).r);
    }
    return farthest > here + slope.x + slope.y + room;
#else
    return any(greaterThan(max(change.xy, change.zw), slope + room));
#endif
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 sum = vec4(0.0);
    float count = 0.0;
    for (int k = 0; k < FRAGMENTS; ++k) {
        vec4 fragment = texelFetch(drawn, pixel, k);
        sum += fragment;
        count += fragment.a > 0.0 ? 1.0 : 0.0;
    }
    bool is_mean = count == 0.0 || !is_silhouette(pixel, depth_at(pixel));
    colour = sum / (is_mean ? float(FRAGMENTS) : count);
}
