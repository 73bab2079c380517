#version 430 core
// A draped feature where the ground that it lies on is what the picture shows.
//   SAMPLES  of the ground's depth along each axis of a pixel
#include "render/frame.glsl"
#include "render/gbuffer.glsl"
#include "render/draped.glsl"

uniform sampler2D ground_depth;
uniform float share; // 0 ... 1: cross-fades

in vec2 part_place;
in vec3 from_eye;
flat in uint part_number;

layout(location = 0) out vec4 colour;

void main()
{
    bool hidden = is_hidden(ground_depth);
    mat2 change = mat2(dFdx(part_place), dFdy(part_place));
    colour = share * draped_colour(part_place, change, draped_parts[part_number], length(from_eye) * trees.z);
    if (hidden || colour.a <= 0.0) discard;
}
