#version 430 core
// Exposure, tone mapping per sample (smooth edges against a bright sky), downsampling, dither against banding.
#include "render/tone.glsl"

uniform sampler2D radiance;  // linear radiance, SAMPLES² texels a pixel
uniform float exposure;

out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 sum = vec3(0.0);
    for (int j = 0; j < SAMPLES; ++j)
        for (int i = 0; i < SAMPLES; ++i)
            sum += film(texelFetch(radiance, pixel * SAMPLES + ivec2(i, j), 0).rgb * exposure);
    uint h = uint(pixel.x) * 1664525u + uint(pixel.y) * 1013904223u;
    h ^= h >> 15; h *= 0x2c1b3c6du; h ^= h >> 12;
    float dither = (float(h & 0xffffu) / 65535.0 - 0.5) / 255.0;
    colour = vec4(sum / float(SAMPLES * SAMPLES) + dither, 1.0);
}
