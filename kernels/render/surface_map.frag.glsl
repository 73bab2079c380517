#version 430 core
// A texel of the map of the drawn terrain (surface_map.glsl), zero where nothing is drawn.
in vec3 ground_normal;
in vec4 material_weights[WEIGHT_WORDS];
in float height_over_eye;

layout(location = 0) out vec4 drawn; // xy: normal; z: height above the eye, m; w: 1
layout(location = 1) out vec4 drawn_weights[WEIGHT_WORDS];

void main()
{
    drawn = vec4(normalize(ground_normal).xy, height_over_eye, 1.0);
    for (int k = 0; k < WEIGHT_WORDS; ++k) drawn_weights[k] = material_weights[k];
}
