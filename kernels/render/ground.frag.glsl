#version 430 core
// What later passes need to know of the ground at a sample. Shading waits until it is known what is seen: tiles far
// away have triangles of a few pixels, and shading those one by one costs many times the picture.
in vec3 ground_normal;
in vec4 weights_low;
in vec4 weights_high;

layout(location = 0) out vec4 gbuffer_normal;
layout(location = 1) out vec4 gbuffer_weights_low;
layout(location = 2) out vec4 gbuffer_weights_high;

void main()
{
    gbuffer_normal = vec4(normalize(ground_normal), 1.0);
    gbuffer_weights_low = weights_low;
    gbuffer_weights_high = weights_high;
}
