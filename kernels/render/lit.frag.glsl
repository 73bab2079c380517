#version 430 core
// All light was found at the vertices.
in vec3 seen;
out vec4 radiance;

void main() { radiance = vec4(seen, 1.0); }
