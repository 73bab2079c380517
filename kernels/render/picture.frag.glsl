#version 430 core
// From light to picture: exposure, tone mapping of every sample on its own (so that edges against a bright sky stay
// smooth), reduction to the picture's size, a dither against banding.
uniform sampler2D drawn;  // linear radiance, SAMPLES² texels a pixel
uniform float exposure;

out vec4 colour;

// Filmic curve fitted to ACES' reference rendering (Hill's fit): linear sRGB in and out.
vec3 film(vec3 c)
{
    const mat3 into = mat3(0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383, 0.04823, 0.01566, 0.83777);
    const mat3 out_of = mat3(1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276, -0.07367, -0.00605, 1.07602);
    c = into * c;
    c = (c * (c + 0.0245786) - 0.000090537) / (c * (0.983729 * c + 0.4329510) + 0.238081);
    return clamp(out_of * c, 0.0, 1.0);
}

vec3 encode(vec3 c)
{
    return mix(12.92 * c, 1.055 * pow(max(c, vec3(1e-5)), vec3(1.0 / 2.4)) - 0.055, step(vec3(0.0031308), c));
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 sum = vec3(0.0);
    for (int j = 0; j < SAMPLES; ++j)
        for (int i = 0; i < SAMPLES; ++i)
            sum += film(texelFetch(drawn, pixel * SAMPLES + ivec2(i, j), 0).rgb * exposure);
    uint h = uint(pixel.x) * 1664525u + uint(pixel.y) * 1013904223u;
    h ^= h >> 15; h *= 0x2c1b3c6du; h ^= h >> 12;
    float dither = (float(h & 0xffffu) / 65535.0 - 0.5) / 255.0;
    colour = vec4(encode(sum / float(SAMPLES * SAMPLES)) + dither, 1.0);
}
