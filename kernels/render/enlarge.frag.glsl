#version 430 core
// Enlargement: bilinear with a smoothstep inside each texel, for crisper edges.
uniform sampler2D tonemapped;

in vec2 uv;
out vec4 colour;

void main()
{
    vec2 size = vec2(textureSize(tonemapped, 0));
    vec2 at = uv * size - 0.5;
    vec2 cell = floor(at), part = at - cell;
    part = mix(part, part * part * (3.0 - 2.0 * part), 0.6);
    colour = vec4(textureLod(tonemapped, (cell + 0.5 + part) / size, 0.0).rgb, 1.0);
}
