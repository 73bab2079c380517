#version 430 core
// Diagnostic colours of the terrain, premultiplied by their opacity.
#include "render/triplanar.glsl"

const int TILES = 0;     // each tile's colour, its borders dark
const int MATERIALS = 1; // palette by weight
const int TRIPLANAR = 2; // red, green, blue: weight of the planes across x, y and z
const int PLAIN = 3;     // each tile's colour, unlit
const int RELIEF = 4;    // light alone

uniform int mode;
uniform float opacity;
uniform vec3 palette[4 * WEIGHT_WORDS];

in vec3 ground_normal;
in vec4 material_weights[WEIGHT_WORDS];
in vec2 along;
in vec4 tile_tint;

out vec4 colour;

void main()
{
    vec3 n = normalize(ground_normal);
    vec3 base = tile_tint.rgb;
    if (mode == MATERIALS) {
        base = vec3(0.0);
        for (int k = 0; k < 4 * WEIGHT_WORDS; ++k) base += material_weights[k / 4][k % 4] * palette[k];
    }
    if (mode == TRIPLANAR) base = triplanar_weights(n);
    if (mode == RELIEF) base = vec3(0.92);
    if (mode != PLAIN) base *= 0.45 + 0.55 * max(dot(n, vec3(-0.5, 0.35, 0.79)), 0.0);
    if (mode == TILES) {
        vec2 pixels = min(along, 1.0 - along) / max(fwidth(along), 1e-6);
        base *= mix(0.35, 1.0, smoothstep(0.5, 1.5, min(pixels.x, pixels.y)));
    }
    colour = vec4(base, 1.0) * (opacity * tile_tint.a);
}
