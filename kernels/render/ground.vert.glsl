#version 430 core
// A vertex of the ground, for ground.frag.glsl.
#include "render/ground.glsl"

void main() { lay_vertex(); }
