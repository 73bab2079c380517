#version 430 core
// Normals of a material's height: rg normal x, y as 0.5 + 0.5 n, b roughness, a how open a point is to the sky.
uniform sampler2D material; // material.frag.glsl
uniform float bump;         // height 0..1 in texture widths
uniform vec2 roughness;     // of the lowest and of the highest points

in vec2 uv;
out vec4 texel;

float height_at(vec2 offset) { return texture(material, uv + offset).a; }

void main()
{
    vec2 t = 1.0 / vec2(textureSize(material, 0));
    float here = height_at(vec2(0.0));
    vec2 slope = vec2(height_at(vec2(t.x, 0.0)) - height_at(vec2(-t.x, 0.0)),
                      height_at(vec2(0.0, t.y)) - height_at(vec2(0.0, -t.y))) * bump / (2.0 * t);
    vec3 n = normalize(vec3(-slope, 1.0));
    float around = 0.0;
    for (int i = 0; i < 8; ++i) {
        float angle = 0.7853982 * float(i);
        vec2 d = vec2(cos(angle), sin(angle));
        around += height_at(d * t * 3.0) + height_at(d * t * 9.0);
    }
    float openness = clamp(1.0 - 2.6 * max(around / 16.0 - here, 0.0) , 0.3, 1.0);
    texel = vec4(0.5 + 0.5 * n.xy, mix(roughness.x, roughness.y, here), openness);
}
