#version 430 core
// A line's colour, premultiplied by its opacity.
in vec4 line_colour;

uniform float opacity;

out vec4 colour;

void main() { colour = vec4(line_colour.rgb, 1.0) * (opacity * line_colour.a); }
