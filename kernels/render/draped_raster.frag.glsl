#version 430 core
// A draped raster on the approximation of the ground.
#include "render/frame.glsl"
#include "render/gbuffer.glsl"

uniform sampler2D ground_depth;
uniform sampler2DArray windows; // rgb: √albedo times opacity; a: opacity; row 0 north
uniform float share;

in vec2 in_window;
flat in float window_layer;

layout(location = 0) out vec4 colour;

void main()
{
    bool hidden = is_hidden(ground_depth);
    vec4 texel = textureLod(windows, vec3(in_window, window_layer), 0.0);
    vec3 root = texel.rgb / max(texel.a, 1e-4);
    colour = share * texel.a * vec4(root * root, 1.0);
    if (hidden || window_layer < 0.0) discard;
}
