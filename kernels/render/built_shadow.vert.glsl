#version 430 core
// A vertex of what is built, in a shadow map.
uniform mat4 to_map; // from the anchor of all vertices to the map's clip space

in vec3 local_position;

void main() { gl_Position = to_map * vec4(local_position, 1.0); }
