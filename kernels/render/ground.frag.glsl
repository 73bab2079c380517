#version 430 core
// G-buffer of the terrain. Shading is deferred: distant tiles have triangles of a few pixels, whose forward shading
// costs many times the picture.
in vec3 ground_normal;
in vec4 material_weights[WEIGHT_WORDS];

layout(location = 0) out vec4 gbuffer_normal;
layout(location = 1) out vec4 gbuffer_weights[WEIGHT_WORDS];

void main()
{
    gbuffer_normal = vec4(normalize(ground_normal), 1.0);
    for (int k = 0; k < WEIGHT_WORDS; ++k) gbuffer_weights[k] = material_weights[k];
}
