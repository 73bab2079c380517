#version 430 core
#include "render/ground.glsl"

void main() { lay_vertex(); }
