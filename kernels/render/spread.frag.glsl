#version 430 core
// Upsampling of shading from one point per pixel to all samples: each takes the neighbour nearest in depth, or the sky.
#include "render/frame.glsl"

uniform sampler2D gbuffer_depth;
uniform sampler2D shaded; // shade_ground.frag.glsl
uniform sampler2D sky;    // sky.frag.glsl, as large

out vec4 radiance;

float inverse_depth(float depth) { return 1.0 / max(1.0 - depth, 1e-7); } // about proportional to the distance

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    float depth = texelFetch(gbuffer_depth, at, 0).r;
    float here = inverse_depth(depth);
    ivec2 pixel = at / SAMPLES;
    ivec2 corner = (at % SAMPLES) * 2 - 1; // direction of the sample's neighbour pixels
    ivec2 last = textureSize(shaded, 0) - 1;
    vec4 best = texelFetch(shaded, pixel, 0);
    float gap = abs(inverse_depth(best.w) - here) * 0.5; // prefers the pixel's own shading
    for (int k = 1; k < 4; ++k) {
        ivec2 other = clamp(pixel + corner * ivec2(k & 1, k >> 1), ivec2(0), last);
        vec4 candidate = texelFetch(shaded, other, 0);
        float candidate_gap = abs(inverse_depth(candidate.w) - here);
        bool better = candidate_gap < gap;
        best = better ? candidate : best;
        gap = min(gap, candidate_gap);
    }
    vec3 behind = texture(sky, (gl_FragCoord.xy) / vec2(textureSize(gbuffer_depth, 0))).rgb;
    radiance = vec4(depth >= 1.0 ? behind : best.rgb, 1.0);
}
