#version 430 core
// Radiance interpolated from the vertices.
in vec3 seen;
out vec4 radiance;

void main() { radiance = vec4(seen, 1.0); }
