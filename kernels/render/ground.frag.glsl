#version 430 core
// G-buffer of the terrain. Shading is deferred: distant tiles have triangles of a few pixels, whose forward shading
// costs many times the picture.
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
