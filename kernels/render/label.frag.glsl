#version 430 core
// Letters over their outline, premultiplied by opacity. The outline is pale, or dark around pale letters.
uniform sampler2D atlas; // r: coverage of letters, g: of letters with their outline

in vec2 texel;
flat in vec4 ink;

out vec4 colour;

const float PALE = 0.55; // luminance of letters from which on their outline is dark
const vec3 LIGHT = vec3(0.96), DARK = vec3(0.1);

void main()
{
    vec2 share = textureLod(atlas, texel / vec2(textureSize(atlas, 0)), 0.0).rg;
    vec3 outline = dot(ink.rgb, vec3(0.2126, 0.7152, 0.0722)) < PALE ? LIGHT : DARK;
    colour = vec4(mix(outline * share.g, ink.rgb, share.r), max(share.r, share.g)) * ink.a;
}
