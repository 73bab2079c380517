#version 430 core
// A surface over water and banks at the highest wet elevation, through which water_bank.frag.glsl reads the ground.
#include "render/frame.glsl"

uniform vec3 anchor; // origin of all positions, relative to the eye, m

in vec3 local_position;  // as in water.vert.glsl
in vec4 flow_frame;
in vec2 shore;
in vec4 stream_params;

out vec3 position;  // on the water surface, m from the eye
out vec4 strip;    // m: from the shore, negative in the bank; of bank; from the centreline and half width of a stream
out float visible; // share of the water

const float LID = 0.75; // m over the water

void main()
{
    bool sea = stream_params.w < 0.0;
    position = anchor + local_position * (sea ? view_range.x : 1.0);
    visible = stream_params.z;
    strip = vec4(sea ? vec2(1.0) : shore, flow_frame.x, stream_params.w);
    gl_Position = to_clip * vec4(position + vec3(0.0, 0.0, LID), 1.0);
}
