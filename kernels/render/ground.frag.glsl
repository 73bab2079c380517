#version 430 core
// What later passes need to know of the ground at a sample. Shading waits until it is known what is seen: tiles far
// away have triangles of a few pixels, and shading those one by one costs many times the picture.
in vec3 ground_normal;
in vec4 weights_low;
in vec4 weights_high;

layout(location = 0) out vec4 seen_normal;
layout(location = 1) out vec4 seen_low;
layout(location = 2) out vec4 seen_high;

void main()
{
    seen_normal = vec4(normalize(ground_normal), 1.0);
    seen_low = weights_low;
    seen_high = weights_high;
}
