#version 430 core
// Terrain vertices for ground.frag.glsl.
#include "render/ground.glsl"

void main() { emit_vertex(); }
