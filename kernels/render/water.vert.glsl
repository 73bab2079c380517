#version 430 core
// A river's surface: a strip along its centreline, wider than the water; the banks cut it.
#include "render/frame.glsl"

uniform vec3 anchor; // of the strip's positions, relative to the eye, m

in vec3 place;  // m from the anchor
in vec4 course; // x: m across, from the centreline; y: m along; zw: unit vector downstream

out vec3 position;
out vec4 flow;

void main()
{
    position = anchor + place;
    flow = course;
    gl_Position = to_clip * vec4(position, 1.0);
}
