#version 430 core
#include "render/ground.glsl"

out vec3 ground_normal;
out vec4 weights_low;
out vec4 weights_high;

invariant gl_Position;

void main()
{
    ivec2 place = place_in_tile();
    float share = parent_share(place);
    ground_normal = ground_normal_at(share);
    weights_low = low_weights_at(share);
    weights_high = high_weights_at(share);
    gl_Position = to_clip * vec4(ground_position(place, share), 1.0);
}
