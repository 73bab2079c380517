#version 430 core
// Composites an overlay with samples² samples per pixel over a picture.
uniform sampler2D overlay;
uniform int samples;

out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy) * samples;
    vec4 sum = vec4(0.0);
    for (int k = 0; k < samples * samples; ++k) sum += texelFetch(overlay, pixel + ivec2(k % samples, k / samples), 0);
    colour = sum / float(samples * samples);
}
