#version 430 core
// A texel of the map of the drawn terrain (surface_map.glsl), zero where nothing is drawn.
in vec3 ground_normal;
in vec4 weights_low;
in vec4 weights_high;
in float height_over_eye;

layout(location = 0) out vec4 drawn;      // xy: normal; z: height above the eye, m; w: 1
layout(location = 1) out vec4 drawn_low;  // grass, soil, rock, scree
layout(location = 2) out vec4 drawn_high; // sand, snow, river bed, forest floor

void main()
{
    drawn = vec4(normalize(ground_normal).xy, height_over_eye, 1.0);
    drawn_low = weights_low;
    drawn_high = weights_high;
}
